#pragma once

#include <optional>
#include <string>

#include "cellmap/core/stamp.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

// Staged maps (store/staging.hpp) in the SQL engines: rows of the table of maps whose names begin
// with a point. Each function expects to run inside one transaction.

/// Returns the name.
std::string insert_staged_map(SqlConnection& connection, const LatticeSpec& lattice, Stamp created);
void rename_staged_map(SqlConnection& connection, const std::string& staged,
                       const std::string& name);
/// Of those that nobody makes any more: created before a time, or all.
void remove_staged_maps(SqlConnection& connection, std::optional<Stamp> created_before);

}  // namespace cellmap
