#pragma once

#include <cstdint>

#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/geometry/lattice.hpp"

namespace cellmap {

enum class PlaneFit {
  kTrimmed,  ///< closed-form PCA, refitted twice without the farthest points: no seed, 8-11x faster
  kRansac,   ///< the paper's, seeded, then PCA over the inliers
};

/// How a local map becomes a CELL. Defaults are the paper's where it gives one.
struct CellBuildOptions {
  double max_range_gap_m = 3.0;  ///< a larger gap between sorted ranges makes the patch invalid
  std::uint32_t min_points = 6;  ///< patches with fewer points keep no plane
  // The owner of this room adds planarity, grazing, trimming, RANSAC and seed options, each with
  // its effect, unit and measured cost.
  PlaneFit fit = PlaneFit::kTrimmed;
  int threads = 1;  ///< 0: all. The bytes do not depend on it.

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// Builds the CELL of a local map (paper, Sec. III-B, steps 2 to 4): geometry, stamps, scan range and
/// statistics are filled in; session and sequence are the caller's. Deterministic: the same input
/// gives the same bytes for any thread count and on any machine.
Cell build_cell(const LocalMap& local_map, const Lattice& lattice, const CellBuildOptions& options);

}  // namespace cellmap
