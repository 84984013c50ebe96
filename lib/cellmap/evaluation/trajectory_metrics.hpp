#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "cellmap/geometry/pose.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap {

/// Errors of an estimated trajectory against the truth.
struct TrajectoryErrors {
  std::size_t poses = 0;  ///< pairs compared
  double length_m = 0;    ///< of the truth
  /// KITTI odometry devkit: mean over all sub-sequences of 100, 200, ..., 800 m that start at every
  /// tenth pose. A sub-sequence ends at the first pose *beyond* its length; its error is divided by
  /// the nominal length. NaN (`segments` = 0) where the drive is not longer than 100 m.
  std::size_t segments = 0;
  double t_rel_percent = 0;
  double r_rel_deg_per_100m = 0;
  double ape_rmse_m = 0;    ///< absolute position error after rigid Umeyama alignment
  double ape_max_m = 0;     ///< the greatest of them, after the same alignment
  double rpe_rmse_m = 0;    ///< relative pose error between consecutive poses, translation
  double rpe_rmse_deg = 0;  ///< and rotation
};

/// Compares pose by pose. Both have the same length, poses in the same sensor frame, any world
/// frames; a different sensor frame (camera, LiDAR) changes the figures slightly. O(n).
/// Throws Error{kInvalidArgument} where lengths differ, there are fewer than 3 poses or one is not
/// rigid.
TrajectoryErrors evaluate_trajectory(const std::vector<Pose>& estimate,
                                     const std::vector<Pose>& truth);

/// The same for stamped trajectories: each estimate pose against the truth at its stamp
/// (interpolated; those outside the truth's time are left out). Both clocks must be the same.
/// Throws Error{kInvalidArgument} where fewer than 3 poses remain.
TrajectoryErrors evaluate_trajectory(const Trajectory& estimate, const Trajectory& truth);

/// Rigid Umeyama alignment: the T_truth_estimate that minimises the squared position error. Where
/// the positions lie on a line, the turn about it is arbitrary. Throws as `evaluate_trajectory`.
Pose align(const std::vector<Pose>& estimate, const std::vector<Pose>& truth);

/// One JSON object, its keys the fields' names; null where `segments` = 0 leaves no value.
std::string to_json(const TrajectoryErrors& errors);

/// A small table for people.
std::string to_table(const TrajectoryErrors& errors);

}  // namespace cellmap
