#include "cellmap/store/open_store.hpp"

#include "cellmap/store/postgres_store.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "cellmap/store/store_place.hpp"

namespace cellmap {

std::unique_ptr<Store> open_store(const std::string& place,
                                  const std::optional<ObjectStoreOptions>& objects) {
  const auto file = store_file(place);
  return file ? open_sqlite_store(*file) : open_postgres_store(place, {.objects = objects});
}

std::unique_ptr<Store> open_store_to_read(const std::string& place,
                                          const std::optional<ObjectStoreOptions>& objects) {
  const auto file = store_file(place);
  if (!file) return open_postgres_store(place, {.objects = objects});
  SqliteStoreOptions options;
  options.read_only = true;
  return open_sqlite_store(*file, options);
}

}  // namespace cellmap
