#include "cellmap/cell/cell.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <string_view>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr float kMaxDistanceM = 10'000;
constexpr double kMinNorm = 1 - 1e-3, kMaxNorm = 1 + 1e-3;
constexpr std::size_t kMaxSessionLength = 64;

void require(bool holds, std::string_view broken) {
  if (!holds)
    throw Error(ErrorCode::kCorruptData, "this CELL is not valid: " + std::string(broken));
}

bool is_unit(const Plane& p) {
  const double nx = p.nx, ny = p.ny, nz = p.nz;
  const double norm2 = nx * nx + ny * ny + nz * nz;
  return norm2 >= kMinNorm * kMinNorm && norm2 <= kMaxNorm * kMaxNorm;  // and no NaN
}

bool is_distance(float distance_m) { return distance_m > 0 && distance_m <= kMaxDistanceM; }

bool faces_origin(const Plane& p, const Eigen::Vector3d& direction) {
  return p.nx * direction.x() + p.ny * direction.y() + p.nz * direction.z() < 0;
}

/// Directions of some lattice points at a time, so many that they stay in the nearest cache.
class DirectionBlocks {
 public:
  static constexpr std::size_t kSize = 256;

  explicit DirectionBlocks(const Lattice& lattice) : lattice_(lattice) {}

  /// Calls `use(k, direction of indices[k])` for all k in order.
  template <typename Use>
  void visit(std::span<const std::uint32_t> indices, const Use& use) {
    for (std::size_t begin = 0; begin < indices.size(); begin += kSize) {
      const auto part = indices.subspan(begin, std::min(kSize, indices.size() - begin));
      lattice_.directions(part, x_.data(), y_.data(), z_.data());
      for (std::size_t k = 0; k < part.size(); ++k) {
        use(begin + k, Eigen::Vector3d(x_[k], y_[k], z_[k]));
      }
    }
  }

 private:
  const Lattice& lattice_;
  std::array<double, kSize> x_, y_, z_;
};

}  // namespace

bool is_session_name(std::string_view name) {
  return !name.empty() && name.size() <= kMaxSessionLength &&
         std::all_of(name.begin(), name.end(), [](char c) {
           return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
                  c == '.' || c == '_' || c == '-';
         });
}

void validate(const Cell& cell) {
  require(is_session_name(cell.session),
          "its session name must be 1 to 64 characters of A-Z a-z 0-9 . _ -");
  require(cell.first_stamp <= cell.last_stamp, "its last stamp is before its first");
  require(is_rigid(cell.T_odom_cell), "its odometry pose is not a rigid transform");
  validate_planes(cell.lattice, cell.indices, cell.planes);
}

void validate_plane(const Plane& plane, const Eigen::Vector3d& direction, std::uint32_t index) {
  if (is_unit(plane) && is_distance(plane.distance_m) && faces_origin(plane, direction)) return;
  const std::string broken = !is_unit(plane)                  ? "a normal is not a unit vector"
                             : !is_distance(plane.distance_m) ? "a distance is outside (0, 10000] m"
                                                              : "a normal does not face the origin";
  require(false, broken + " at lattice point " + std::to_string(index));
}

void validate_planes(const LatticeSpec& spec, std::span<const std::uint32_t> indices,
                     std::span<const Plane> planes) {
  if (indices.size() != planes.size()) {
    require(false, "it has " + std::to_string(indices.size()) + " indices for " +
                       std::to_string(planes.size()) + " planes");
  }
  const Lattice lattice(spec);
  for (std::size_t k = 0; k < indices.size(); ++k) {
    require(indices[k] < lattice.size(), "an index is outside its lattice");
    require(k == 0 || indices[k - 1] < indices[k], "its indices are not strictly increasing");
  }
  DirectionBlocks(lattice).visit(indices, [&](std::size_t k, const Eigen::Vector3d& direction) {
    validate_plane(planes[k], direction, indices[k]);
  });
}

PointCloud reconstruct_points(const Cell& cell, const Lattice& lattice) {
  PointCloud points;
  points.reserve(cell.planes.size());
  DirectionBlocks(lattice).visit(cell.indices,
                                 [&](std::size_t k, const Eigen::Vector3d& direction) {
                                   const double distance = cell.planes[k].distance_m;
                                   points.push_back((distance * direction).cast<float>());
                                 });
  return points;
}

}  // namespace cellmap
