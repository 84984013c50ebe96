#pragma once

#include <span>

#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

// What the SQLite engine writes. Each function expects to run inside one transaction that the
// caller commits, or rolls back where the function throws. Arguments have been validated.

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

/// zstd frames of the kept bytes of an update, in the order of its CELLs.
struct UpdateFrames {
  std::vector<Bytes> cells, recoded;
};
CommitResult apply_update(SqliteConnection& connection, const std::string& map,
                          const MapUpdate& update, const UpdateFrames& frames);

JobId insert_job(SqliteConnection& connection, const JobRecord& job);
void replace_job(SqliteConnection& connection, const JobRecord& job);

}  // namespace cellmap
