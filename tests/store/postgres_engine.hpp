#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <string>

#include "cellmap/store/object_store.hpp"
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

/// The tests' object store (support/object_store.sh), a prefix of its own for a test's folder;
/// nullopt where none runs.
inline std::optional<ObjectStoreOptions> objects_for(const std::filesystem::path& folder) {
  const char* const place = std::getenv("CELLMAP_TEST_OBJECTS");
  ObjectStoreOptions options;
  if (place == nullptr ||
      !(std::ifstream(std::filesystem::path(place) / "address") >> options.endpoint)) {
    return std::nullopt;
  }
  options.place = "s3://cells/test-" + std::to_string(std::hash<std::string>()(folder.string()));
  options.access_key = options.secret_key = "S3RVER";
  return options;
}

}  // namespace cellmap::test
