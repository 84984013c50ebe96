#pragma once

#include <string>

#include "cellmap/core/stamp.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/store/sqlite_connection.hpp"

namespace cellmap {

// Staged maps (store/staging.hpp) in the SQLite engine: rows of the table of maps whose names begin
// with a point. Each function expects to run inside one transaction.

/// Returns the name.
std::string insert_staged_map(SqliteConnection& connection, const LatticeSpec& lattice,
                              Stamp created);
void rename_staged_map(SqliteConnection& connection, const std::string& staged,
                       const std::string& name);
/// Of those that nobody makes any more.
void remove_staged_maps(SqliteConnection& connection);

}  // namespace cellmap
