#pragma once

#include <cstddef>
#include <vector>

#include "cellmap/geometry/pose.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap {

/// Errors of an estimated trajectory against the truth.
struct TrajectoryErrors {
  std::size_t poses = 0;             ///< pairs compared
  double length_m = 0;               ///< of the truth
  /// KITTI odometry devkit: mean over all sub-sequences of 100, 200, ..., 800 m that start at every
  /// tenth pose. NaN (`segments` = 0) where the drive is shorter than 100 m.
  std::size_t segments = 0;
  double t_rel_percent = 0;
  double r_rel_deg_per_100m = 0;
  double ape_rmse_m = 0;             ///< absolute position error after rigid Umeyama alignment
  double ape_max_m = 0;
  double rpe_rmse_m = 0;             ///< relative pose error between consecutive poses, translation
  double rpe_rmse_deg = 0;           ///< and rotation
};

/// Compares pose by pose. Both have the same length, poses in the same sensor frame, any world
/// frames. Throws Error{kInvalidArgument} where lengths differ or there are fewer than 3 poses.
TrajectoryErrors evaluate_trajectory(const std::vector<Pose>& estimate, const std::vector<Pose>& truth);

/// The same for stamped trajectories: each estimate pose against the truth at its stamp (interpolated;
/// those outside the truth's time are left out).
TrajectoryErrors evaluate_trajectory(const Trajectory& estimate, const Trajectory& truth);

/// Rigid Umeyama alignment: the T_truth_estimate that minimises the squared position error.
Pose align(const std::vector<Pose>& estimate, const std::vector<Pose>& truth);

}  // namespace cellmap
