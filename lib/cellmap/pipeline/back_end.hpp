#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "cellmap/map/junction.hpp"
#include "cellmap/pipeline/front_end.hpp"
#include "cellmap/pipeline/mapper_options.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/pose_graph/map_changes.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// Everything that one finished CELL changes in a map; a store commits it as one transaction.
struct CellUpdate {
  CellId id;
  std::shared_ptr<const Cell> cell;          ///< null where it was there before
  std::vector<ScanInCell> scans;             ///< the cell's stretch of the trajectory
  std::vector<Constraint> constraints;       ///< new, unnumbered
  std::map<ConstraintId, Judgement> judged;  ///< numbered ones whose weight changed
  std::map<CellId, Pose> poses;              ///< T_map_cell: of the new CELL and of all that moved
  bool unaligned = false;                    ///< the new CELL is not in the map frame
  std::set<CellId> aligned;                  ///< CELLs that joined the map frame with this one
  std::uint64_t raw_points = 0;              ///< points of its scans before filtering
  std::uint64_t voxel_points = 0;            ///< FinishedCell::voxel_points
};

/// What the back end reads of the map: it knows every CELL of the graphs that are handed in.
struct MapAccess {
  TargetProvider targets;
  PlaceProvider places = {};  ///< may be empty: islands are not joined then
};

/// CELLs of one session into a map (paper, Sec. III-C and D): each is tied to the one before it and
/// to earlier visits, its session joins the rest of the map where the two meet, and the graph is
/// made consistent. The map may change between two CELLs, so it is handed in each time: several
/// sessions may write to one map in turns. One owner.
class BackEnd {
 public:
  BackEnd(MapperOptions options, MapAccess access);

  /// Continues a session after its last CELL in the map.
  void resume_after(CellId id, FinishedCell last);

  /// Adds the next CELL of the session to the graph and makes it consistent. Its id is the
  /// graph's `new_cell_id`. The first CELL of a session in a map that is not empty starts an island
  /// at its odometry pose. Where a session joins the map, loops are closed for the last 50 of its
  /// CELLs too.
  CellUpdate integrate(FinishedCell next, PoseGraph& graph);

  /// Looks once more for what ties a CELL of the graph to other islands and visits, as when it
  /// came, and makes the graph consistent. The update has no `cell`.
  CellUpdate revisit(CellId id, FinishedCell cell, PoseGraph& graph) const;

 private:
  struct Neighbour {
    CellId id;
    FinishedCell cell;
  };

  void close(const Neighbour& cell, PoseGraph& graph, CellUpdate& update) const;
  std::vector<Constraint> tie_to_previous(CellId id, const FinishedCell& next) const;
  bool is_believable(const RegistrationResult& result, const Pose& T_odometry) const;
  std::vector<Constraint> close_loops(CellId id, const PointCloud& points,
                                      const TargetProvider& targets, const PoseGraph& graph) const;
  void close_loops_of(const std::set<CellId>& joined, const Neighbour& next,
                      PoseGraph& graph) const;
  std::vector<Constraint> join_islands(const Neighbour& next, PoseGraph& graph) const;
  TargetProvider targets_with(const Neighbour& next) const;

  MapperOptions options_;
  MapAccess access_;
  std::optional<Neighbour> previous_;
};

}  // namespace cellmap
