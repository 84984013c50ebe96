#pragma once

#include <mutex>

#include "cellmap/store/sql_connection.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

// What the SQL engines read of maps, pose graphs and jobs. Each function expects to run inside
// one transaction, so that all its statements see one revision.

/// A row of the table of maps.
struct MapRow {
  std::int64_t key = 0;  ///< column `id`, never reused
  MapInfo info;          ///< without bounds, sessions and `kept`
  std::uint32_t next_constraint = 1;
  CellId next_cell{1};  ///< PoseGraph::next_cell
  Revision oldest = 0;  ///< that can be read
};

Error no_map(const std::string& name);
/// Error{kNotFound} where there is no such map.
MapRow read_map_row(SqlConnection& connection, const std::string& name);
/// The same, newest, and nobody else writes to the map until the transaction ends.
MapRow lock_map_row(SqlConnection& connection, const std::string& name);

/// Bounds, sessions and forms of maps, which take a pass over a map's CELLs to find, but change
/// only with its revision; so the last answer is kept. Thread safe; not for use inside a write,
/// whose revision may never come to be.
class MapSummaries {
 public:
  /// The row's map with those.
  MapInfo complete(SqlConnection& connection, MapRow row);

 private:
  struct Summary {
    Revision revision = 0;
    Eigen::AlignedBox3d bounds;
    std::vector<std::string> sessions;
    std::map<CellForm, std::uint64_t> kept;
  };
  static Summary read(SqlConnection& connection, const MapRow& row);

  std::mutex mutex_;
  std::map<std::int64_t, Summary> by_key_;
};

/// By name.
std::vector<MapInfo> read_maps(SqlConnection& connection, MapSummaries& summaries);

PoseGraph read_pose_graph(SqlConnection& connection, const std::string& map,
                          std::optional<Revision> revision);
MapChanges read_changes(SqlConnection& connection, const std::string& map, Revision since);

/// By name.
std::vector<SessionInfo> read_sessions(SqlConnection& connection, const std::string& map);

JobRecord read_job(SqlConnection& connection, JobId id);
/// By id.
std::vector<JobRecord> read_jobs(SqlConnection& connection, const std::optional<std::string>& map);

}  // namespace cellmap
