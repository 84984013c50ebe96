#include "cellmap/pipeline/refine.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

const Pose& pose_of(const std::map<CellId, Pose>& poses, CellId id) {
  const auto found = poses.find(id);
  if (found == poses.end()) {
    throw Error(ErrorCode::kInvalidArgument,
                "the pose of CELL " + std::to_string(id.value) + " is missing");
  }
  return found->second;
}

/// Metres travelled from the CELL's base scan to each of its scans and, last, to the next CELL.
std::vector<double> distances(const CellScans& stretch, const Pose& T_cell_next) {
  std::vector<double> metres;
  double total = 0;
  Eigen::Vector3d at = Eigen::Vector3d::Zero();
  const auto travel_to = [&](const Eigen::Vector3d& position) {
    total += (position - at).norm();
    at = position;
    metres.push_back(total);
  };
  for (const ScanInCell& scan : stretch.scans) travel_to(scan.T_cell_scan.translation());
  travel_to(T_cell_next.translation());
  return metres;
}

void append_stretch(const CellScans& stretch, const CellScans* next,
                    const std::map<CellId, Pose>& poses, std::vector<StampedPose>& trajectory) {
  const Pose& T_map_cell = pose_of(poses, stretch.cell);
  Pose T_odom_next = Pose::Identity();   // the next CELL, in this CELL's frame, as odometry saw it
  Tangent correction = Tangent::Zero();  // of the next CELL: exp(correction) * T_odom_next is right
  std::vector<double> metres(stretch.scans.size() + 1, 0.0);
  if (next != nullptr) {
    T_odom_next = stretch.T_odom_cell.inverse() * next->T_odom_cell;
    const Pose T_right = T_map_cell.inverse() * pose_of(poses, next->cell);
    correction = log(T_right * T_odom_next.inverse());
    metres = distances(stretch, T_odom_next);
  }
  for (std::size_t i = 0; i < stretch.scans.size(); ++i) {
    const double share = metres.back() > 0 ? metres[i] / metres.back() : 0.0;
    const ScanInCell& scan = stretch.scans[i];
    trajectory.push_back({scan.stamp, T_map_cell * exp(share * correction) * scan.T_cell_scan});
  }
}

}  // namespace

Trajectory corrected_trajectory(std::span<const CellScans> stretches,
                                const std::map<CellId, Pose>& poses) {
  std::vector<StampedPose> trajectory;
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    const CellScans* next = i + 1 < stretches.size() ? &stretches[i + 1] : nullptr;
    append_stretch(stretches[i], next, poses, trajectory);
  }
  return Trajectory(std::move(trajectory));
}

}  // namespace cellmap
