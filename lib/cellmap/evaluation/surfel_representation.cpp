#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numbers>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/evaluation/compared_drive.hpp"
#include "cellmap/evaluation/point_bytes.hpp"
#include "cellmap/evaluation/representation.hpp"

namespace cellmap {
namespace {

constexpr std::uint32_t kMinPoints = 6;
/// Of a voxel's edge: rms distance of its points from their plane.
constexpr double kMaxThickness = 0.2;
constexpr std::size_t kSurfelFloats = 7;
constexpr int kCorners = 6;

/// Sums over a voxel's points, about its first one.
struct Sums {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero(), sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d products = Eigen::Matrix3d::Zero();
  std::uint32_t points = 0;

  void add(const Eigen::Vector3d& p) {
    if (points++ == 0) origin = p;
    const Eigen::Vector3d d = p - origin;
    sum += d;
    products += d * d.transpose();
  }
};

std::vector<Sums> voxel_sums(const PointCloud& points, double voxel_m) {
  const std::vector<std::size_t> voxels = voxels_of(points, voxel_m);
  std::vector<Sums> sums;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (voxels[i] == sums.size()) sums.emplace_back();
    sums[voxels[i]].add(points[i].cast<double>());
  }
  return sums;
}

/// The surfel of a voxel, if its points lie in a plane.
void add_surfel(const Sums& sums, double voxel_m, Bytes& bytes) {
  if (sums.points < kMinPoints) return;
  const double n = sums.points;
  const Eigen::Vector3d mean = sums.sum / n;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(sums.products / n - mean * mean.transpose());
  const Eigen::Vector3d variances = solver.eigenvalues().cwiseMax(0);
  if (std::sqrt(variances[0]) > kMaxThickness * voxel_m || variances[1] < 1e-6) return;
  const Eigen::Vector3f centre = (sums.origin + mean).cast<float>();
  const Eigen::Vector3f normal = solver.eigenvectors().col(0).cast<float>();
  // A disc has the variance r^2 / 4 along both of its axes.
  const auto radius = static_cast<float>(std::sqrt(2 * (variances[1] + variances[2])));
  for (const float value :
       {centre.x(), centre.y(), centre.z(), normal.x(), normal.y(), normal.z(), radius}) {
    append_number(bytes, value);
  }
}

DecodedMap read_surfels(const Bytes& bytes) {
  if (bytes.size() % (kSurfelFloats * sizeof(float)) != 0) {
    throw Error(ErrorCode::kCorruptData, "expected surfels of 28 bytes each");
  }
  DecodedMap map;
  // A hexagon of this radius has the area of the unit disc.
  const double circumradius =
      std::sqrt(2 * std::numbers::pi / (kCorners * std::sin(2 * std::numbers::pi / kCorners)));
  for (std::size_t at = 0; at < bytes.size(); at += kSurfelFloats * sizeof(float)) {
    float v[kSurfelFloats];
    std::memcpy(v, bytes.data() + at, sizeof(v));
    const Eigen::Vector3f centre(v[0], v[1], v[2]), normal(v[3], v[4], v[5]);
    map.points.push_back(centre);
    map.normals.push_back(normal);
    const Eigen::Vector3d side = normal.cast<double>().unitOrthogonal();
    const Eigen::Vector3d up = normal.cast<double>().cross(side);
    std::array<Eigen::Vector3d, kCorners> corners;
    for (int k = 0; k < kCorners; ++k) {
      const double angle = 2 * std::numbers::pi * k / kCorners;
      corners[k] = centre.cast<double>() +
                   circumradius * v[6] * (std::cos(angle) * side + std::sin(angle) * up);
    }
    map.surface.add_polygon(corners);
  }
  return map;
}

}  // namespace

Representation surfels(double voxel_m) {
  char name[32];
  std::snprintf(name, sizeof(name), "surfels, %g m", voxel_m);
  return {name,
          [voxel_m](const ComparedDrive& drive) {
            MapFiles files = {{"surfels.bin", {}}};
            for (const Sums& sums : voxel_sums(stacked_points(drive), voxel_m)) {
              add_surfel(sums, voxel_m, files.front().bytes);
            }
            return files;
          },
          [](const MapFiles& files) { return read_surfels(files.at(0).bytes); }};
}

}  // namespace cellmap
