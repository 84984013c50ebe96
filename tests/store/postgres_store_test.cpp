#include "cellmap/store/postgres_store.hpp"

#include <gtest/gtest.h>

#include "cellmap/store/postgres_schema.hpp"
#include "store/postgres_engine.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

StoreEngine postgres_engine() {
  return {"postgres", [](const std::filesystem::path& folder) -> std::unique_ptr<Store> {
            if (!postgres_address()) return nullptr;
            return open_postgres_store(postgres_address_for(folder));
          }};
}

INSTANTIATE_TEST_SUITE_P(Postgres, StoreContract, ::testing::Values(postgres_engine()));

}  // namespace
}  // namespace cellmap::test
