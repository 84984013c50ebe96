#pragma once

#include <array>
#include <optional>
#include <span>

#include "cellmap/cell/plane_fit.hpp"
#include "cellmap/cell/point_runs.hpp"
#include "cellmap/cell/range_gap.hpp"

namespace cellmap {

/// The plane of some sums, by which points are judged while the sums grow.
struct JudgingPlane {
  std::optional<FittedPlane> plane;  ///< none: every point is kept
  double points = 0;                 ///< that the sums held when it was fitted
};

/// All that PlaneFit::kStreaming keeps of the points of a patch. Like the trimmed fit it refits
/// twice, but a point is judged when its scan comes, by the planes of the points so far: those
/// within the rms limit of the plane of the sums n are added to the sums n + 1. Planes are fitted
/// anew once their sums have grown by a quarter: later, one more scan hardly moves them.
struct PatchSums {
  static constexpr std::size_t kRefits = 2;
  static constexpr double kGrowth = 1.25;

  Eigen::Vector3d origin = Eigen::Vector3d::Zero();  ///< the first point
  std::array<simd::Moments, kRefits + 1> sums;       ///< about it; the first holds all points
  std::array<JudgingPlane, kRefits> judging;
  RangeClusters ranges;

  bool is_due(std::size_t refit) const {
    return sums[refit].count >= kGrowth * judging[refit].points;
  }
  std::uint32_t points() const { return static_cast<std::uint32_t>(sums.front().count); }
};

/// Adds the points that one scan has in each of at most kPatchesAFit patches.
void add_scan(std::span<PatchPoints> scan, const CellBuildOptions& options,
              std::span<PatchSums* const> patches);

}  // namespace cellmap
