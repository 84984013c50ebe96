#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "cellmap/cell/cell.hpp"

namespace cellmap {

/// The farthest that a point of `source` moves along its normal when its plane is replaced by
/// `decoded`, over the disc of `radius_rad` around `direction` (a patch of the lattice, as
/// Lattice::patch_radius_rad has it), in metres. A point moves along the ray that it is seen along:
/// from where the ray meets the one plane to where it meets the other.
///
/// Exact, not sampled. With m = n / (n . p) of either plane and the ray v, the point moves by
/// ((m . v) / (m' . v) - 1) / |m|, which over a disc is extreme on its rim; there the extremes are
/// the roots of a quadratic. Infinite where the decoded plane leaves the disc (some ray does not
/// meet it); 0 where both are the same bits. Where the source leaves the disc, an upper bound.
double plane_displacement_m(const Plane& source, const Plane& decoded,
                            const Eigen::Vector3d& direction, double radius_rad);

/// How far a decoded CELL is from its source.
struct CellDisplacement {
  double worst_m = 0, p99_m = 0, median_m = 0;  ///< over planes; of no planes 0
  std::uint32_t worst_index = 0;                ///< lattice point of the worst plane
};

/// Of every plane over its patch's disc. Throws Error{kInvalidArgument} where the two have not the
/// same lattice and lattice points. About 0.2 us a plane.
CellDisplacement cell_displacement(const Cell& source, const Cell& decoded);

}  // namespace cellmap
