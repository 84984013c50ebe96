#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/geometry/lattice.hpp"

namespace cellmap {

enum class PlaneFit {
  kTrimmed,  ///< closed-form PCA, refitted twice without the farthest points: no seed, 8-11x faster
  kRansac,   ///< the paper's, seeded, then PCA over the inliers
  kStreaming,  ///< from sums that are kept as scans arrive, each trimmed by the plane so far
};

/// "trimmed", "ransac" or "streaming", as flags and requests name them; nothing where `name` is
/// none.
std::string to_string(PlaneFit fit);
std::optional<PlaneFit> plane_fit_from(std::string_view name);

/// How a local map becomes a CELL. Defaults are the paper's where it gives one.
struct CellBuildOptions {
  /// A larger gap between neighbours in the sorted ranges of a patch, the last gap included, means
  /// foreground and background and makes the patch invalid (paper, Sec. III-B, step 3).
  double max_range_gap_m = 3.0;
  /// Patches with fewer points keep no plane. At least 3.
  std::uint32_t min_points = 6;
  /// Patches whose kept points have a larger rms distance from their plane keep none. 0: no test.
  double max_plane_rms_m = 0.0;
  /// Patches whose points lie along a line have no certain normal: the variance of the kept points
  /// across the plane must be at most this share of the smaller variance within it. 1: no test.
  double max_thickness_ratio = 0.3;
  /// Standard error of the normal, sqrt(variance across / (points x smaller variance within)),
  /// above which a patch keeps no plane. 90: no test.
  double max_normal_error_deg = 90.0;
  /// Planes that are met at a smaller angle by the ray of their lattice point keep none: there a
  /// small error of the normal becomes a large one of the distance.
  double min_grazing_angle_deg = 1.0;
  /// The plane must meet the ray of its lattice point at a distance no more than this outside the
  /// patch's own range span; beyond, it extrapolates. Counted as grazing.
  double range_margin_m = 1.0;
  PlaneFit fit = PlaneFit::kTrimmed;
  /// kTrimmed: each of two refits leaves out the points farther from the last plane than this many
  /// rms distances.
  double trim_rms_factor = 1.5;
  /// kRansac: planes drawn through three points, and the distance within which a point agrees.
  std::uint32_t ransac_draws = 30;
  double ransac_inlier_m = 0.1;
  /// kRansac: mixed with the lattice index, so a patch draws the same points on any thread.
  std::uint64_t seed = 1;
  int threads = 1;  ///< 0: all. The bytes do not depend on it.

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// Builds the CELL of a local map (paper, Sec. III-B, steps 2 to 4): geometry, stamps, scan range
/// and statistics are filled in; session and sequence are the caller's. Deterministic: the same
/// input gives the same bytes for any thread count and on any machine.
Cell build_cell(const LocalMap& local_map, const Lattice& lattice, const CellBuildOptions& options);

}  // namespace cellmap
