#pragma once

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// What a compact archive keeps of a pose graph: of every number the digits that say something, so
/// that the rest are zeros, which take no room. Positions move by at most 2^-17 m (8 um) along each
/// axis, coefficients of rotations by 2^-29, those of an information matrix by 2^-24 of the
/// largest; scores and weights are floats. What would no longer be valid stays as it is. Twice is
/// the same as once. Linear.
PoseGraph to_archive_precision(PoseGraph graph);

}  // namespace cellmap
