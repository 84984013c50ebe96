#include "cellmap/store/sqlite_store.hpp"

#include "store/store_contract.hpp"

namespace cellmap::test {

StoreEngine sqlite_engine() {
  return {"sqlite", [](const std::filesystem::path& folder) {
            return open_sqlite_store(folder / "test.cellmap");
          }};
}

INSTANTIATE_TEST_SUITE_P(Sqlite, StoreContract, ::testing::Values(sqlite_engine()));

}  // namespace cellmap::test
