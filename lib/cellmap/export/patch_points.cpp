#include "cellmap/export/patch_points.hpp"

#include <algorithm>
#include <cmath>

#include "cellmap/cell/patch_outline.hpp"

namespace cellmap {
namespace {

using Outline = std::array<Eigen::Vector2d, kOutlineCorners>;

/// Corners in order, either way round.
bool is_inside(const Outline& outline, const Eigen::Vector2d& p) {
  bool left = true, right = true;
  for (std::size_t k = 0; k < kOutlineCorners; ++k) {
    const Eigen::Vector2d edge = outline[(k + 1) % kOutlineCorners] - outline[k];
    const Eigen::Vector2d to_p = p - outline[k];
    const double side = edge.x() * to_p.y() - edge.y() * to_p.x();
    left = left && side >= 0;
    right = right && side <= 0;
  }
  return left || right;
}

}  // namespace

PointsOnPatches patch_points(const Cell& cell, const Lattice& lattice, const Pose& T_target_cell,
                             double spacing_m) {
  PointsOnPatches result;
  const auto add = [&](const Eigen::Vector3d& p, const Eigen::Vector3d& normal) {
    result.points.push_back((T_target_cell * p).cast<float>());
    result.normals.push_back((T_target_cell.linear() * normal).cast<float>());
  };
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const Plane& plane = cell.planes[k];
    const std::uint32_t index = cell.indices[k];
    const Eigen::Vector3d direction = lattice.direction(index);
    const Eigen::Vector3d centre = plane.distance_m * direction;
    const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
    add(centre, normal);
    if (!(spacing_m > 0)) continue;
    const auto corners = patch_outline(plane, direction, lattice.patch_radius_rad(index));
    const Eigen::Vector3d side = normal.unitOrthogonal(), up = normal.cross(side);
    Outline outline;
    Eigen::Vector2d reach(0, 0);
    for (std::size_t c = 0; c < kOutlineCorners; ++c) {
      const Eigen::Vector3d off = corners[c] - centre;
      outline[c] = {off.dot(side), off.dot(up)};
      reach = reach.cwiseMax(outline[c].cwiseAbs());
    }
    const int columns = static_cast<int>(reach.x() / spacing_m);
    const int rows = static_cast<int>(reach.y() / spacing_m);
    for (int i = -columns; i <= columns; ++i) {
      for (int j = -rows; j <= rows; ++j) {
        const Eigen::Vector2d p(i * spacing_m, j * spacing_m);
        if ((i == 0 && j == 0) || !is_inside(outline, p)) continue;
        add(centre + p.x() * side + p.y() * up, normal);
      }
    }
  }
  return result;
}

}  // namespace cellmap
