#pragma once

#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

// What the SQLite engine reads of maps, pose graphs and jobs. Each function expects to run inside
// one transaction, so that all its statements see one revision.

/// A row of the table of maps.
struct MapRow {
  std::int64_t key = 0;  ///< column `id`, never reused
  MapInfo info;          ///< without bounds and sessions
  std::uint32_t next_constraint = 1;
};

/// Error{kNotFound} where there is no such map.
MapRow read_map_row(SqliteConnection& connection, const std::string& name);
MapInfo read_map(SqliteConnection& connection, const std::string& name);
/// By name.
std::vector<MapInfo> read_maps(SqliteConnection& connection);

PoseGraph read_pose_graph(SqliteConnection& connection, const std::string& map,
                          std::optional<Revision> revision);
MapChanges read_changes(SqliteConnection& connection, const std::string& map, Revision since);

JobRecord read_job(SqliteConnection& connection, JobId id);
/// By id.
std::vector<JobRecord> read_jobs(SqliteConnection& connection,
                                 const std::optional<std::string>& map);

}  // namespace cellmap
