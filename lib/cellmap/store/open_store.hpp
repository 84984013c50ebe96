#pragma once

#include <memory>
#include <optional>
#include <string>

#include "cellmap/store/object_store.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// Opens the store at a place (store_place.hpp) for reading and writing, and makes it where it is
/// missing. `objects`: where a database has the bytes of its CELLs (PostgresStoreOptions); a file
/// has them itself. Throws as `open_sqlite_store` and `open_postgres_store` do.
std::unique_ptr<Store> open_store(const std::string& place,
                                  const std::optional<ObjectStoreOptions>& objects = {});

/// Opens one that is there, beside a process that writes it: changes of an SQLite store are
/// refused. Error{kNotFound} where there is no such file.
std::unique_ptr<Store> open_store_to_read(const std::string& place,
                                          const std::optional<ObjectStoreOptions>& objects = {});

}  // namespace cellmap
