#include "cellmap/cell/patch_outline.hpp"

#include <cmath>
#include <numbers>

namespace cellmap {

std::array<Eigen::Vector3d, kOutlineCorners> patch_outline(const Plane& plane,
                                                           const Eigen::Vector3d& direction,
                                                           double patch_radius_rad) {
  // A hexagon of this radius has the area of the unit disc.
  const double circumradius =
      std::sqrt(2 * std::numbers::pi / (kOutlineCorners * std::sin(std::numbers::pi / 3)));
  const double slope = std::tan(circumradius * patch_radius_rad);
  const Eigen::Vector3d side = direction.unitOrthogonal();
  const Eigen::Vector3d up = direction.cross(side);
  const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
  const Eigen::Vector3d centre = plane.distance_m * direction;
  const double longest = kLongestCorner * plane.distance_m;
  std::array<Eigen::Vector3d, kOutlineCorners> corners;
  for (std::size_t k = 0; k < kOutlineCorners; ++k) {
    const double angle = -2 * std::numbers::pi * static_cast<double>(k) / kOutlineCorners;
    const Eigen::Vector3d ray = direction + slope * (std::cos(angle) * side + std::sin(angle) * up);
    // From the centre to where the ray meets the plane, times how steeply it does (negative): a
    // ray along the plane or away from it has no such point, but the same way there.
    const double facing = -normal.dot(ray);
    const Eigen::Vector3d way = -(normal.dot(centre) * ray + facing * centre);
    const double length = way.norm();
    if (length == 0) {
      corners[k] = centre;
      continue;
    }
    const bool meets = facing > 0 && length < longest * facing;
    corners[k] = centre + way * (meets ? 1 / facing : longest / length);
  }
  return corners;
}

TriangleMesh patch_mesh(const Cell& cell, const Lattice& lattice, const Pose& T_target_cell) {
  TriangleMesh mesh;
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const std::uint32_t index = cell.indices[k];
    auto corners =
        patch_outline(cell.planes[k], lattice.direction(index), lattice.patch_radius_rad(index));
    for (Eigen::Vector3d& corner : corners) corner = T_target_cell * corner;
    mesh.add_polygon(corners);
  }
  return mesh;
}

}  // namespace cellmap
