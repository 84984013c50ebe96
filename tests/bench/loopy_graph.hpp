#pragma once

#include <cstdint>
#include <vector>

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap::bench {

/// True poses of CELLs of a drive that revisits its streets: KITTI 00's ground truth by the 6 m
/// rule (578 CELLs), empty where the data is not there.
std::vector<Pose> kitti00_cell_poses();

/// The same for a random drive on a grid of streets, blocks of 60 m.
std::vector<Pose> street_grid_poses(std::size_t count);

/// Measurements of a drive with the mapper's uncertainties: neighbours (2 % and 0.1 deg), and for
/// each pose up to four loops to earlier poses within 8 m (5 cm and 0.1 deg). Nodes start where the
/// chain of neighbours puts them.
PoseGraph loopy_graph(const std::vector<Pose>& truth, std::uint64_t seed);

}  // namespace cellmap::bench
