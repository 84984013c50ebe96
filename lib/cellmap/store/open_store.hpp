#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "cellmap/store/store.hpp"

namespace cellmap {

// A store's place, as the programs' --store takes it: the name of an SQLite file, with or without
// "sqlite:" before it, or the address of a PostgreSQL database (`is_postgres_address`).

/// The file of a place; nullopt for a database.
std::optional<std::filesystem::path> store_file(const std::string& place);

/// Opens the store at a place for reading and writing, and makes it where it is missing. Throws as
/// `open_sqlite_store` and `open_postgres_store` do.
std::unique_ptr<Store> open_store(const std::string& place);

/// Opens one that is there, beside a process that writes it: changes of an SQLite store are
/// refused. Error{kNotFound} where there is no such file.
std::unique_ptr<Store> open_store_to_read(const std::string& place);

}  // namespace cellmap
