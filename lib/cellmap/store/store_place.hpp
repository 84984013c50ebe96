#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace cellmap {

// A store's place, as the programs' --store takes it: the name of an SQLite file, with or without
// "sqlite:" before it, or the address of a PostgreSQL database.

/// Whether a place is the address of a PostgreSQL database ("postgresql://..." or
/// "postgres://...").
bool is_postgres_address(const std::string& place);

/// The file of a place; nullopt for a database. Error{kInvalidArgument} for another address.
std::optional<std::filesystem::path> store_file(const std::string& place);

}  // namespace cellmap
