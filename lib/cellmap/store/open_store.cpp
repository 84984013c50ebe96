#include "cellmap/store/open_store.hpp"

#include "cellmap/core/error.hpp"
#include "cellmap/store/postgres_store.hpp"
#include "cellmap/store/sqlite_store.hpp"

namespace cellmap {
namespace {

constexpr std::string_view kSqlite = "sqlite:";

}  // namespace

std::optional<std::filesystem::path> store_file(const std::string& place) {
  if (is_postgres_address(place)) return std::nullopt;
  if (place.starts_with(kSqlite)) return place.substr(kSqlite.size());
  // A file may be named "a://b", but who writes that means an address.
  if (place.find("://") != std::string::npos) {
    throw Error(ErrorCode::kInvalidArgument,
                "store: expected the name of a file or postgresql://[user@]host/database, found '" +
                    place.substr(0, place.find("://")) + "://...'");
  }
  return place;
}

std::unique_ptr<Store> open_store(const std::string& place) {
  const auto file = store_file(place);
  return file ? open_sqlite_store(*file) : open_postgres_store(place);
}

std::unique_ptr<Store> open_store_to_read(const std::string& place) {
  const auto file = store_file(place);
  if (!file) return open_postgres_store(place);
  SqliteStoreOptions options;
  options.read_only = true;
  return open_sqlite_store(*file, options);
}

}  // namespace cellmap
