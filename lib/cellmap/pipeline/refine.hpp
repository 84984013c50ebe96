#pragma once

#include <map>
#include <span>
#include <vector>

#include "cellmap/cell/local_map.hpp"
#include "cellmap/core/id.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap {

/// One CELL's stretch of a drive.
struct CellScans {
  CellId cell;
  Pose T_odom_cell = Pose::Identity();
  std::vector<ScanInCell> scans;
  std::uint64_t raw_points = 0;    ///< of its scans before filtering
  std::uint64_t voxel_points = 0;  ///< FinishedCell::voxel_points
};

/// The pose of every scan after the back end: each scan keeps its pose relative to its CELL, and
/// what the back end changed between a CELL and the next of the session is spread over the scans
/// between them by distance travelled, so that the trajectory has no steps. `stretches` in order of
/// the drive; `poses` holds T_map_cell of each. Throws Error{kInvalidArgument} where a pose is
/// missing.
Trajectory corrected_trajectory(std::span<const CellScans> stretches,
                                const std::map<CellId, Pose>& poses);

}  // namespace cellmap
