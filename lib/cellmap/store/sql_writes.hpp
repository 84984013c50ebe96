#pragma once

#include "cellmap/store/sql_connection.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

// What the SQL engines writes beside updates (sql_update.hpp). Each function expects to run
// inside one transaction that the caller commits, or rolls back where the function throws.
// Arguments have been validated.

/// The transaction excludes all others that write.
void insert_map(SqlConnection& connection, const std::string& name, const LatticeSpec& lattice,
                const CellForm& form, Stamp created);

// Of those below that take the key of a map: nobody else writes to it.

/// Removes everything of a map, and the contents that no other map uses.
void remove_map(SqlConnection& connection, std::int64_t map);
void write_georeference(SqlConnection& connection, std::int64_t map,
                        const std::optional<Georeference>& georeference);
void write_form(SqlConnection& connection, std::int64_t map, const CellForm& form);
void write_document(SqlConnection& connection, std::int64_t map, const std::string& name,
                    const std::string& text);
void insert_session(SqlConnection& connection, const MapRow& map, const SessionInfo& session);

JobId insert_job(SqlConnection& connection, const JobRecord& job);
void replace_job(SqlConnection& connection, const JobRecord& job);

}  // namespace cellmap
