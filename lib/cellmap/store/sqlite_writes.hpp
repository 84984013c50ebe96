#pragma once

#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

// What the SQLite engine writes beside updates (sqlite_update.hpp). Each function expects to run
// inside one transaction that the caller commits, or rolls back where the function throws.
// Arguments have been validated.

void insert_map(SqliteConnection& connection, const std::string& name, const LatticeSpec& lattice,
                const CellForm& form, Stamp created);
/// Removes everything of a map, and the blobs that no other map uses.
void remove_map(SqliteConnection& connection, const std::string& name);

void write_georeference(SqliteConnection& connection, const std::string& map,
                        const std::optional<Georeference>& georeference);
void write_form(SqliteConnection& connection, const std::string& map, const CellForm& form);
void write_document(SqliteConnection& connection, const std::string& map, const std::string& name,
                    const std::string& text);
void insert_session(SqliteConnection& connection, const std::string& map,
                    const SessionInfo& session);

JobId insert_job(SqliteConnection& connection, const JobRecord& job);
void replace_job(SqliteConnection& connection, const JobRecord& job);

}  // namespace cellmap
