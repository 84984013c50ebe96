#pragma once

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

#include "cellmap/store/postgres_connection.hpp"
#include "store/store_contract.hpp"

namespace cellmap::test {

/// The address of the tests' PostgreSQL (support/postgres.sh); nullopt where none runs.
inline std::optional<std::string> postgres_address() {
  const char* const folder = std::getenv("CELLMAP_TEST_POSTGRES");
  std::error_code none;
  if (folder == nullptr || !std::filesystem::exists(folder, none)) return std::nullopt;
  const auto socket_folder = std::filesystem::canonical(folder);
  return "postgresql:///postgres?user=postgres&host=" + socket_folder.string();
}

/// The address of a schema of its own for a test's folder, made where it is not there.
inline std::string postgres_address_for(const std::filesystem::path& folder) {
  const std::string schema = "test_" + std::to_string(std::hash<std::string>()(folder.string()));
  PostgresConnection(*postgres_address())
      .execute(("CREATE SCHEMA IF NOT EXISTS " + schema).c_str());
  return *postgres_address() + "&options=-csearch_path%3D" + schema;
}

}  // namespace cellmap::test
