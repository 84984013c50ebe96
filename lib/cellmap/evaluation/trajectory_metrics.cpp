#include "cellmap/evaluation/trajectory_metrics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;
constexpr double kNoSegments = std::numeric_limits<double>::quiet_NaN();

// The KITTI odometry devkit's choice.
constexpr std::array<double, 8> kSegmentLengthsM = {100, 200, 300, 400, 500, 600, 700, 800};
constexpr std::size_t kSegmentStep = 10;

void validate(const std::vector<Pose>& estimate, const std::vector<Pose>& truth) {
  if (estimate.size() != truth.size()) {
    throw Error(ErrorCode::kInvalidArgument,
                "an estimate and its truth must have as many poses: found " +
                    std::to_string(estimate.size()) + " and " + std::to_string(truth.size()));
  }
  if (estimate.size() < 3) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected at least 3 poses to compare, found " + std::to_string(estimate.size()));
  }
  for (const std::vector<Pose>* poses : {&estimate, &truth}) {
    const auto bad = std::find_if_not(poses->begin(), poses->end(), is_rigid);
    if (bad != poses->end()) {
      throw Error(ErrorCode::kInvalidArgument,
                  "pose " + std::to_string(bad - poses->begin()) + " of the " +
                      (poses == &truth ? "truth" : "estimate") + " is not a rigid transform");
    }
  }
}

/// Metres travelled up to each pose.
std::vector<double> distances_m(const std::vector<Pose>& poses) {
  std::vector<double> distances(poses.size(), 0.0);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    distances[i] = distances[i - 1] + (poses[i].translation() - poses[i - 1].translation()).norm();
  }
  return distances;
}

/// How far the motion from `first` to `last` is estimated wrong.
Pose motion_error(const std::vector<Pose>& estimate, const std::vector<Pose>& truth,
                  std::size_t first, std::size_t last) {
  const Pose T_true = truth[first].inverse() * truth[last];
  const Pose T_estimated = estimate[first].inverse() * estimate[last];
  return T_estimated.inverse() * T_true;
}

double angle_rad(const Pose& T) { return angle_between_rad(Pose::Identity(), T); }

void evaluate_segments(const std::vector<Pose>& estimate, const std::vector<Pose>& truth,
                       const std::vector<double>& distances, TrajectoryErrors& errors) {
  double translation = 0;  // metres a metre
  double rotation = 0;     // radians a metre
  for (std::size_t first = 0; first < truth.size(); first += kSegmentStep) {
    for (const double length : kSegmentLengthsM) {
      // The first pose beyond the length; its error is divided by the nominal length, as there.
      const auto last = std::upper_bound(distances.begin() + static_cast<std::ptrdiff_t>(first),
                                         distances.end(), distances[first] + length);
      if (last == distances.end()) break;
      const Pose error =
          motion_error(estimate, truth, first, static_cast<std::size_t>(last - distances.begin()));
      translation += error.translation().norm() / length;
      rotation += angle_rad(error) / length;
      ++errors.segments;
    }
  }
  const double count = errors.segments > 0 ? static_cast<double>(errors.segments) : kNoSegments;
  errors.t_rel_percent = 100.0 * translation / count;
  errors.r_rel_deg_per_100m = 100.0 * kDegreesPerRadian * rotation / count;
}

void evaluate_positions(const std::vector<Pose>& estimate, const std::vector<Pose>& truth,
                        TrajectoryErrors& errors) {
  const Pose T_truth_estimate = align(estimate, truth);
  double sum = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const double error =
        (T_truth_estimate * estimate[i].translation() - truth[i].translation()).norm();
    sum += error * error;
    errors.ape_max_m = std::max(errors.ape_max_m, error);
  }
  errors.ape_rmse_m = std::sqrt(sum / static_cast<double>(truth.size()));
}

void evaluate_steps(const std::vector<Pose>& estimate, const std::vector<Pose>& truth,
                    TrajectoryErrors& errors) {
  double translation = 0;
  double rotation = 0;
  for (std::size_t i = 1; i < truth.size(); ++i) {
    const Pose error = motion_error(estimate, truth, i - 1, i);
    translation += error.translation().squaredNorm();
    rotation += std::pow(angle_rad(error), 2);
  }
  const double steps = static_cast<double>(truth.size() - 1);
  errors.rpe_rmse_m = std::sqrt(translation / steps);
  errors.rpe_rmse_deg = std::sqrt(rotation / steps) * kDegreesPerRadian;
}

/// A matrix of positions, one a column.
Eigen::Matrix3Xd positions(const std::vector<Pose>& poses) {
  Eigen::Matrix3Xd columns(3, poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    columns.col(static_cast<Eigen::Index>(i)) = poses[i].translation();
  }
  return columns;
}

}  // namespace

Pose align(const std::vector<Pose>& estimate, const std::vector<Pose>& truth) {
  validate(estimate, truth);
  Pose T = Pose::Identity();
  T.matrix() = Eigen::umeyama(positions(estimate), positions(truth), /*with_scaling=*/false);
  return T;
}

TrajectoryErrors evaluate_trajectory(const std::vector<Pose>& estimate,
                                     const std::vector<Pose>& truth) {
  validate(estimate, truth);
  const std::vector<double> distances = distances_m(truth);
  TrajectoryErrors errors;
  errors.poses = truth.size();
  errors.length_m = distances.back();
  evaluate_segments(estimate, truth, distances, errors);
  evaluate_positions(estimate, truth, errors);
  evaluate_steps(estimate, truth, errors);
  return errors;
}

TrajectoryErrors evaluate_trajectory(const Trajectory& estimate, const Trajectory& truth) {
  std::vector<Pose> estimated, true_poses;
  for (const StampedPose& pose : estimate.poses()) {
    const std::optional<Pose> true_pose = truth.at(pose.stamp);
    if (!true_pose) continue;
    estimated.push_back(pose.pose);
    true_poses.push_back(*true_pose);
  }
  if (estimated.size() < 3) {
    throw Error(ErrorCode::kInvalidArgument,
                "expected at least 3 poses of the estimate within the time of the truth, found " +
                    std::to_string(estimated.size()) + " of " + std::to_string(estimate.size()));
  }
  return evaluate_trajectory(estimated, true_poses);
}

std::string to_json(const TrajectoryErrors& errors) {
  const nlohmann::ordered_json json = {
      {"poses", errors.poses},
      {"length_m", errors.length_m},
      {"segments", errors.segments},
      {"t_rel_percent", errors.t_rel_percent},  // NaN is written as null
      {"r_rel_deg_per_100m", errors.r_rel_deg_per_100m},
      {"ape_rmse_m", errors.ape_rmse_m},
      {"ape_max_m", errors.ape_max_m},
      {"rpe_rmse_m", errors.rpe_rmse_m},
      {"rpe_rmse_deg", errors.rpe_rmse_deg},
  };
  return json.dump();
}

std::string to_table(const TrajectoryErrors& errors) {
  std::array<char, 512> text;
  const auto relative = [&](double value, const char* unit) {
    std::array<char, 64> cell;
    std::snprintf(cell.data(), cell.size(), "%.3f %s", value, unit);
    return errors.segments > 0 ? std::string(cell.data()) : "- (drive under 100 m)";
  };
  std::snprintf(text.data(), text.size(),
                "poses compared       %zu over %.1f m\n"
                "KITTI translation    %s\n"
                "KITTI rotation       %s\n"
                "KITTI segments       %zu\n"
                "APE (aligned)        %.3f m rmse, %.3f m max\n"
                "RPE (pose to pose)   %.4f m rmse, %.4f deg rmse\n",
                errors.poses, errors.length_m, relative(errors.t_rel_percent, "%").c_str(),
                relative(errors.r_rel_deg_per_100m, "deg/100 m").c_str(), errors.segments,
                errors.ape_rmse_m, errors.ape_max_m, errors.rpe_rmse_m, errors.rpe_rmse_deg);
  return text.data();
}

}  // namespace cellmap
