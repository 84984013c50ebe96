#include "cellmap/cell/cell.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <string_view>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr float kMaxDistanceM = 10'000;
constexpr std::size_t kMaxSessionLength = 64;

void require(bool holds, std::string_view broken) {
  if (!holds)
    throw Error(ErrorCode::kCorruptData, "this CELL is not valid: " + std::string(broken));
}

void validate_plane(const Plane& plane, const Lattice& lattice, std::uint32_t index) {
  const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
  const auto where = [&] { return " at lattice point " + std::to_string(index); };
  if (!normal.allFinite() || std::abs(normal.norm() - 1) > 1e-3) {
    require(false, "a normal is not a unit vector" + where());
  }
  if (!(plane.distance_m > 0 && plane.distance_m <= kMaxDistanceM)) {
    require(false, "a distance is outside (0, 10000] m" + where());
  }
  if (!(normal.dot(lattice.direction(index)) < 0)) {
    require(false, "a normal does not face the origin" + where());
  }
}

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

void validate_planes(const LatticeSpec& spec, std::span<const std::uint32_t> indices,
                     std::span<const Plane> planes) {
  require(indices.size() == planes.size(), "it has " + std::to_string(indices.size()) +
                                               " indices for " + std::to_string(planes.size()) +
                                               " planes");
  const Lattice lattice(spec);
  for (std::size_t k = 0; k < indices.size(); ++k) {
    require(indices[k] < spec.size, "an index is outside its lattice");
    require(k == 0 || indices[k - 1] < indices[k], "its indices are not strictly increasing");
    validate_plane(planes[k], lattice, indices[k]);
  }
}

PointCloud reconstruct_points(const Cell& cell, const Lattice& lattice) {
  PointCloud points;
  points.reserve(cell.planes.size());
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const double distance = cell.planes[k].distance_m;
    points.push_back((distance * lattice.direction(cell.indices[k])).cast<float>());
  }
  return points;
}

}  // namespace cellmap
