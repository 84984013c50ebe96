#include "cellmap/evaluation/compared_drive.hpp"

#include <cmath>
#include <string>
#include <unordered_map>
#include <utility>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// Whether scan `i` of `scans` is held back, so that `count` of them are.
bool is_held_back(std::size_t i, std::size_t scans, std::size_t count) {
  return (2 * i + 1) * count / (2 * scans) < (2 * i + 3) * count / (2 * scans) && i > 0;
}

struct Mean {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  std::uint32_t points = 0;
};

}  // namespace

ComparedDrive read_compared_drive(ScanSource& source, const ScanFilterOptions& filter,
                                  std::size_t held_back, bool use_truth,
                                  const std::function<void(std::size_t)>& progress) {
  filter.validate();
  if (source.size() < held_back + 2) {
    throw Error(ErrorCode::kInvalidArgument, "expected a drive of at least " +
                                                 std::to_string(held_back + 2) + " scans to hold " +
                                                 std::to_string(held_back) + " back, found " +
                                                 std::to_string(source.size()));
  }
  const Trajectory& truth = source.ground_truth();
  const bool with_truth = use_truth && truth.size() == source.size();
  ComparedDrive drive;
  Pose T_map_world = Pose::Identity();
  Eigen::Vector3d last = Eigen::Vector3d::Zero();
  std::size_t i = 0;
  while (const auto raw = source.next()) {
    const Pose T_world_scan = with_truth ? truth[i].pose : raw->T_odom_sensor;
    if (i == 0) T_map_world = T_world_scan.inverse();
    PlacedScan placed{filter_scan(raw->points, raw->stamp, filter), T_map_world * T_world_scan};
    drive.length_m += (placed.T_map_scan.translation() - last).norm();
    last = placed.T_map_scan.translation();
    const bool back = is_held_back(i, source.size(), held_back);
    (back ? drive.held_back : drive.mapped).push_back(std::move(placed));
    ++i;
    if (progress) progress(i);
  }
  return drive;
}

PointCloud stacked_points(const ComparedDrive& drive) {
  PointCloud stacked;
  for (const PlacedScan& placed : drive.mapped) {
    stacked.append(transformed(placed.scan.points, placed.T_map_scan));
  }
  return stacked;
}

std::vector<std::size_t> voxels_of(const PointCloud& points, double voxel_m) {
  std::unordered_map<std::uint64_t, std::size_t> place_of;
  std::vector<std::size_t> voxels;
  voxels.reserve(points.size());
  const auto part = [&](float v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(v / voxel_m)) +
                                      (1 << 20)) &
           0x1fffffU;
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::uint64_t key = part(points.x[i]) << 42 | part(points.y[i]) << 21 | part(points.z[i]);
    voxels.push_back(place_of.try_emplace(key, place_of.size()).first->second);
  }
  return voxels;
}

PointCloud voxel_means(const PointCloud& points, double voxel_m) {
  const std::vector<std::size_t> voxels = voxels_of(points, voxel_m);
  std::vector<Mean> means;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (voxels[i] == means.size()) means.emplace_back();
    means[voxels[i]].sum += points[i].cast<double>();
    ++means[voxels[i]].points;
  }
  PointCloud result;
  result.reserve(means.size());
  for (const Mean& mean : means) {
    result.push_back((mean.sum / static_cast<double>(mean.points)).cast<float>());
  }
  return result;
}

}  // namespace cellmap
