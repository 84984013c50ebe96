#pragma once

#include <array>
#include <cstddef>

#include "cellmap/cell/cell.hpp"
#include "cellmap/geometry/triangle_mesh.hpp"

namespace cellmap {

constexpr std::size_t kOutlineCorners = 6;
constexpr double kLongestCorner = 0.25;

/// Where a plane is cut by the edge of its patch: a hexagon on the plane, cell frame, around the
/// plane's point on its lattice direction. Six rays around that direction span the patch's mean
/// solid angle. No corner is farther from the middle than `kLongestCorner` times the plane's
/// distance: a plane that is met at a small angle leaves its patch far from where it was measured.
std::array<Eigen::Vector3d, kOutlineCorners> patch_outline(const Plane& plane,
                                                           const Eigen::Vector3d& direction,
                                                           double patch_radius_rad);

/// The outlines of all planes, moved by `T_target_cell`.
TriangleMesh patch_mesh(const Cell& cell, const Lattice& lattice, const Pose& T_target_cell);

}  // namespace cellmap
