#pragma once

#include "cellmap/cell/cell.hpp"
#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// Points on the patches of a CELL and the normal of the patch at each.
struct PointsOnPatches {
  PointCloud points, normals;  ///< same length
};

/// Every plane at its lattice direction, and, with `spacing_m` > 0, a square grid of that spacing
/// around it within the patch's outline (cell/patch_outline.hpp). Moved by `T_target_cell`.
PointsOnPatches patch_points(const Cell& cell, const Lattice& lattice, const Pose& T_target_cell,
                             double spacing_m);

}  // namespace cellmap
