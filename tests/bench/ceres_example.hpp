#pragma once

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap::bench {

/// The formulation of the pose-graph example that comes with Ceres: positions and quaternions as
/// parameters, residuals (position error, twice the vector part of the quaternion error) whitened
/// by the square root of the information, derivatives by automatic differentiation, quaternion
/// manifold, sparse normal equations, at most 200 iterations, every other option at its default, no
/// robust loss. The first node keeps its pose.
void optimize_as_ceres_example(PoseGraph& graph, int threads);

}  // namespace cellmap::bench
