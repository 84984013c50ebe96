#include "cellmap/cell/patch_sums.hpp"

#include <cassert>
#include <cmath>
#include <optional>

namespace cellmap {
namespace {

void add_ranges(const PatchPoints& points, double max_gap_m, RangeClusters& clusters) {
  const simd::SquaredRanges range2 = simd::squared_ranges(points.view());
  const double min_m = std::sqrt(range2.min), max_m = std::sqrt(range2.max);
  if (!(max_m - min_m > max_gap_m)) {
    clusters.add(min_m, max_m, max_gap_m);
    return;
  }
  std::vector<double> ranges_m(simd::padded(points.size()));
  simd::ranges(points.view(), ranges_m.data());
  for (const double range_m : ranges_m) clusters.add(range_m, range_m, max_gap_m);
}

}  // namespace

void add_scan(std::span<PatchPoints> scan, const CellBuildOptions& options,
              std::span<PatchSums* const> patches) {
  assert(scan.size() <= kPatchesAFit && patches.size() == scan.size());
  std::array<simd::Moments, kPatchesAFit> of_scan;
  std::array<MomentsAbout, kPatchesAFit> so_far;
  std::array<std::optional<FittedPlane>, kPatchesAFit> planes;
  for (std::size_t k = 0; k < scan.size(); ++k) {
    PatchSums& patch = *patches[k];
    if (patch.points() == 0) patch.origin = scan[k][0];
    scan[k].set_origin(patch.origin);
    add_ranges(scan[k], options.max_range_gap_m, patch.ranges);
    of_scan[k] = simd::moments(scan[k].view());
    patch.sums[0] = patch.sums[0] + of_scan[k];
  }
  for (std::size_t refit = 0; refit < PatchSums::kRefits; ++refit) {
    for (std::size_t k = 0; k < scan.size(); ++k) {
      so_far[k] = {patches[k]->origin, patches[k]->sums[refit]};
    }
    fit_planes(std::span(so_far).first(scan.size()), planes);
    for (std::size_t k = 0; k < scan.size(); ++k) {
      simd::Moments kept = of_scan[k];
      if (planes[k]) {
        kept = kept - moments_off_plane(scan[k], *planes[k], options.trim_rms_factor);
      }
      patches[k]->sums[refit + 1] = patches[k]->sums[refit + 1] + kept;
    }
  }
}

}  // namespace cellmap
