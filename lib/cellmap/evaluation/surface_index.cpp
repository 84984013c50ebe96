#include "cellmap/evaluation/surface_index.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace cellmap {
namespace {

using Voxel = std::array<std::int64_t, 3>;

constexpr std::uint64_t key_of(const Voxel& voxel) {
  constexpr std::int64_t kOffset = 1 << 20;
  constexpr std::uint64_t kMask = (1 << 21) - 1;
  const auto part = [](std::int64_t v) { return static_cast<std::uint64_t>(v + kOffset) & kMask; };
  return part(voxel[0]) << 42 | part(voxel[1]) << 21 | part(voxel[2]);
}

Voxel voxel_of(const Eigen::Vector3d& p, double size_m) {
  const auto part = [&](double v) { return static_cast<std::int64_t>(std::floor(v / size_m)); };
  return {part(p.x()), part(p.y()), part(p.z())};
}

double distance_to_segment(const Eigen::Vector3d& p, const Eigen::Vector3d& a,
                           const Eigen::Vector3d& b) {
  const Eigen::Vector3d edge = b - a;
  const double squared = edge.squaredNorm();
  const double t = squared > 0 ? std::clamp((p - a).dot(edge) / squared, 0.0, 1.0) : 0.0;
  return (p - a - t * edge).norm();
}

/// How far the point is from the voxel's cube.
double distance_to_voxel(const Eigen::Vector3d& p, const Voxel& voxel, double size_m) {
  Eigen::Vector3d off;
  for (int axis = 0; axis < 3; ++axis) {
    const double low = static_cast<double>(voxel[axis]) * size_m;
    off[axis] = std::max({low - p[axis], p[axis] - low - size_m, 0.0});
  }
  return off.norm();
}

}  // namespace

double distance_to_triangle(const Eigen::Vector3d& p,
                            const std::array<Eigen::Vector3d, 3>& triangle) {
  const auto& [a, b, c] = triangle;
  const Eigen::Vector3d normal = (b - a).cross(c - a);
  const double squared = normal.squaredNorm();
  if (squared > 0) {
    const bool above = (b - a).cross(p - a).dot(normal) >= 0 &&
                       (c - b).cross(p - b).dot(normal) >= 0 &&
                       (a - c).cross(p - c).dot(normal) >= 0;
    if (above) return std::abs((p - a).dot(normal)) / std::sqrt(squared);
  }
  return std::min(
      {distance_to_segment(p, a, b), distance_to_segment(p, b, c), distance_to_segment(p, c, a)});
}

SurfaceIndex::SurfaceIndex(const TriangleMesh& mesh, double limit_m)
    : mesh_(mesh), limit_m_(limit_m) {
  for (std::uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = mesh.corners(t);
    const Voxel low = voxel_of(a.cwiseMin(b).cwiseMin(c), limit_m_);
    const Voxel high = voxel_of(a.cwiseMax(b).cwiseMax(c), limit_m_);
    for (std::int64_t x = low[0]; x <= high[0]; ++x) {
      for (std::int64_t y = low[1]; y <= high[1]; ++y) {
        for (std::int64_t z = low[2]; z <= high[2]; ++z) voxels_[key_of({x, y, z})].push_back(t);
      }
    }
  }
}

double SurfaceIndex::distance(const Eigen::Vector3d& p) const {
  const Voxel middle = voxel_of(p, limit_m_);
  double nearest = limit_m_;
  const auto look_into = [&](const Voxel& voxel) {
    if (distance_to_voxel(p, voxel, limit_m_) >= nearest) return;
    const auto found = voxels_.find(key_of(voxel));
    if (found == voxels_.end()) return;
    for (const std::uint32_t t : found->second) {
      nearest = std::min(nearest, distance_to_triangle(p, mesh_.corners(t)));
    }
  };
  look_into(middle);  // most often the answer, after which the others are too far away
  for (std::int64_t x = -1; x <= 1; ++x) {
    for (std::int64_t y = -1; y <= 1; ++y) {
      for (std::int64_t z = -1; z <= 1; ++z) {
        if (x != 0 || y != 0 || z != 0) look_into({middle[0] + x, middle[1] + y, middle[2] + z});
      }
    }
  }
  return nearest;
}

PointCloud sample_surface(const TriangleMesh& mesh, std::size_t count) {
  std::vector<double> area_up_to;
  double area = 0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = mesh.corners(t);
    area_up_to.push_back(area += (b - a).cross(c - a).norm() / 2);
  }
  PointCloud samples;
  if (!(area > 0)) return samples;
  samples.reserve(count);
  std::size_t t = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double at = area * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
    while (area_up_to[t] < at) ++t;
    const auto [a, b, c] = mesh.corners(t);
    // Fractional parts of multiples of two irrationals fill the unit square evenly.
    const double n = static_cast<double>(i);
    double u = n * 0.7548776662466927, v = n * 0.5698402909980532;
    u -= std::floor(u);
    v -= std::floor(v);
    if (u + v > 1) u = 1 - u, v = 1 - v;
    samples.push_back((a + u * (b - a) + v * (c - a)).cast<float>());
  }
  return samples;
}

}  // namespace cellmap
