#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/place/relocalise.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// What must come together before two islands become one (pose_graph/frames.hpp). A wrong junction
/// would fold two places over each other, so one answer of place recognition, however sure, is not
/// enough: other CELLs of the island must be found where that answer says that they are.
struct JunctionOptions {
  RelocaliseOptions relocalise;
  LoopOptions confirm;            ///< how a neighbour is registered at its predicted place
  std::size_t confirmations = 2;  ///< neighbours that must be found, beside the CELL that asks
  std::size_t neighbours = 6;    ///< of the CELL that asks, nearest along its island; tried in turn
  double max_distance_m = 12.0;  ///< from a neighbour's predicted place to the CELL it is sought in
  /// A neighbour's measured pose may differ from the predicted one by these, and by the drift of
  /// `confirm` over the path between it and the CELL that asks.
  double max_difference_m = 0.5;
  double max_difference_deg = 1.5;

  void validate() const;
};

/// Hands out descriptors of at least the CELLs of a graph, which are stored already. Never null.
using PlaceProvider = std::function<std::shared_ptr<const PlaceIndex>(const PoseGraph&)>;

/// Closures that tie the island of one CELL to another island; they agree with one another.
struct Junction {
  CellId island, other;  ///< by name
  Pose T_other_island = Pose::Identity();
  std::vector<LoopClosure> closures;  ///< the first is that of the CELL that asked
};

/// Looks for a CELL in the islands that are not its own: they find it without a prior, then
/// neighbours of it are sought where that puts them. `query_scan` is its base scan, or its
/// reconstructed points; `places` is asked for the CELLs of the other islands. Nullopt where there
/// is no other island, nothing is found, or too few neighbours confirm it (too few are there yet,
/// or they lie outside of the other island). About the time of one relocalisation where nothing is
/// found. Deterministic; throws as `relocalise` does.
std::optional<Junction> find_junction(const PoseGraph& graph, CellId query,
                                      const PointCloud& query_scan, const PlaceProvider& places,
                                      const TargetProvider& targets,
                                      const JunctionOptions& options);

/// Moves one island into the frame of the other: the unaligned one into the map frame, or of two
/// unaligned ones that of the higher name. Adds no constraint.
void bring_together(PoseGraph& graph, const Junction& junction);

}  // namespace cellmap
