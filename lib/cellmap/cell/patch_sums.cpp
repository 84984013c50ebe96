#include "cellmap/cell/patch_sums.hpp"

#include <cassert>
#include <cmath>
#include <optional>

namespace cellmap {
namespace {

void add_ranges(const PatchPoints& points, const simd::SquaredRanges& range2, double max_gap_m,
                RangeClusters& clusters) {
  const double min_m = std::sqrt(range2.min), max_m = std::sqrt(range2.max);
  if (!(max_m - min_m > max_gap_m)) {
    clusters.add(min_m, max_m, max_gap_m);
    return;
  }
  std::vector<double> ranges_m(simd::padded(points.size()));
  simd::ranges(points.view(), ranges_m.data());
  for (const double range_m : ranges_m) clusters.add(range_m, range_m, max_gap_m);
}

/// Fits the planes that judge for this refit, where they are due.
void fit_due(std::span<PatchSums* const> patches, std::size_t refit) {
  std::array<MomentsAbout, kPatchesAFit> sums;
  std::array<std::optional<FittedPlane>, kPatchesAFit> planes;
  std::array<PatchSums*, kPatchesAFit> due;
  std::size_t count = 0;
  for (PatchSums* const patch : patches) {
    if (!patch->is_due(refit)) continue;
    sums[count] = {patch->origin, patch->sums[refit]};
    due[count++] = patch;
  }
  fit_planes(std::span(sums).first(count), planes);
  for (std::size_t i = 0; i < count; ++i) {
    due[i]->judging[refit] = {planes[i], due[i]->sums[refit].count};
  }
}

}  // namespace

void add_scan(std::span<PatchPoints> scan, const CellBuildOptions& options,
              std::span<PatchSums* const> patches) {
  assert(scan.size() <= kPatchesAFit && patches.size() == scan.size());
  std::array<simd::Moments, kPatchesAFit> of_scan;
  for (std::size_t k = 0; k < scan.size(); ++k) {
    PatchSums& patch = *patches[k];
    if (patch.points() == 0) patch.origin = scan[k][0];
    scan[k].set_origin(patch.origin);
    const auto [moments, range2] = simd::moments_and_ranges(scan[k].view());
    add_ranges(scan[k], range2, options.max_range_gap_m, patch.ranges);
    of_scan[k] = moments;
    patch.sums[0] = patch.sums[0] + of_scan[k];
  }
  for (std::size_t refit = 0; refit < PatchSums::kRefits; ++refit) {
    fit_due(patches, refit);
    for (std::size_t k = 0; k < scan.size(); ++k) {
      const std::optional<FittedPlane>& plane = patches[k]->judging[refit].plane;
      simd::Moments kept = of_scan[k];
      if (plane) kept = kept - moments_off_plane(scan[k], *plane, options.trim_rms_factor);
      patches[k]->sums[refit + 1] = patches[k]->sums[refit + 1] + kept;
    }
  }
}

}  // namespace cellmap
