#pragma once

#include <set>
#include <string>

#include "cellmap/core/hash.hpp"
#include "cellmap/store/sql_connection.hpp"
#include "cellmap/store/sql_reads.hpp"

namespace cellmap {

/// Removes a session with its CELLs and all constraints of those, and subtracts them from what the
/// row of its map, which nobody else writes to, says of them; the caller writes that. Returns the
/// contents that the CELLs were kept as. Error{kNotFound} where there is no such session.
std::set<ContentHash> remove_session(SqlConnection& connection, MapRow& map,
                                     const std::string& name);

}  // namespace cellmap
