#pragma once

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// Poses to start an optimisation from, made from the constraints alone. In every connected
/// component the node with the lowest id keeps its pose, as in `optimize`. Constraints count with
/// their `weight`; those of weight 0 do not. Both throw Error{kInvalidArgument} where a constraint
/// names a node that is not there, and are deterministic.

/// Every node placed from its neighbour along a breadth-first tree, through constraints of
/// neighbours first and loops only where nothing else reaches. As good as the odometry; linear in
/// nodes and constraints.
std::map<CellId, Pose> spanning_tree_start(const PoseGraph& graph);

/// All constraints at once, in two linear systems (chordal relaxation; Martinec and Pajdla 2007,
/// Carlone et al., ICRA 2015): rotations as unconstrained 3x3 matrices that minimise the sum of
/// k |R_from * R_from_to - R_to|^2, projected to SO(3), then positions given the rotations. k and
/// the positions' weights are means over the axes. Close to the optimum even where the odometry is
/// hopeless, but least squares: a false loop bends it. About a seventh of an optimisation step.
std::map<CellId, Pose> chordal_start(const PoseGraph& graph);

}  // namespace cellmap
