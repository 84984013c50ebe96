#include "cellmap/cell/cell_builder.hpp"

#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "cellmap/cell/patch_sums.hpp"
#include "cellmap/cell/plane_fit.hpp"
#include "cellmap/cell/plane_rules.hpp"
#include "cellmap/cell/point_runs.hpp"
#include "cellmap/cell/range_gap.hpp"
#include "cellmap/core/parallel.hpp"

namespace cellmap {
namespace {

/// The planes of one band from its points, a few patches at a time.
class BandFit {
 public:
  BandFit(const PointCloud& cloud, const PlaneRules& rules, const CellBuildOptions& options)
      : cloud_(cloud), rules_(rules), options_(options) {}

  CellPart fit(std::span<const PointRun> band, std::uint32_t first_patch) {
    if (!band.empty()) {
      band_.sort(cloud_, band);
      for (std::uint32_t i = 0; i < kPatchesABand; ++i) add_patch(band_.of(i), first_patch + i);
    }
    flush();
    return std::move(part_);
  }

 private:
  void add_patch(PatchPoints points, std::uint32_t index) {
    const auto count = static_cast<std::uint32_t>(points.size());
    if (count == 0 || !rules_.has_enough_points(count, part_)) return;
    points.keep(count);
    const auto [moments, range2] = simd::moments_and_ranges(points.view());
    const double min_m = std::sqrt(range2.min), max_m = std::sqrt(range2.max);
    if (has_gap(points, min_m, max_m)) {
      rules_.reject_gap(part_);
      return;
    }
    points_[used_] = points;
    moments_[used_] = {points.origin(), moments};
    extents_[used_] = {index, count, min_m, max_m};
    if (++used_ == kPatchesAFit) flush();
  }

  bool has_gap(const PatchPoints& points, double min_m, double max_m) {
    if (!(max_m - min_m > options_.max_range_gap_m)) return false;
    ranges_m_.resize(simd::padded(points.size()));
    simd::ranges(points.view(), ranges_m_.data());
    return has_range_gap(std::span(ranges_m_).first(points.size()), min_m, max_m,
                         options_.max_range_gap_m);
  }

  void flush() {
    std::array<std::optional<FittedPlane>, kPatchesAFit> planes;
    if (options_.fit == PlaneFit::kRansac) {
      for (std::size_t k = 0; k < used_; ++k) {
        planes[k] = fit_plane_ransac(points_[k], options_, extents_[k].index);
      }
    } else {
      fit_planes_trimmed(std::span(points_).first(used_), std::span(moments_).first(used_),
                         options_, planes);
    }
    for (std::size_t k = 0; k < used_; ++k) rules_.judge(extents_[k], planes[k], part_);
    used_ = 0;
  }

  const PointCloud& cloud_;
  const PlaneRules& rules_;
  const CellBuildOptions& options_;
  BandPoints band_;
  std::array<PatchPoints, kPatchesAFit> points_;
  std::array<MomentsAbout, kPatchesAFit> moments_;  // about their origins
  std::array<PatchExtent, kPatchesAFit> extents_;
  std::size_t used_ = 0;
  std::vector<double> ranges_m_;
  CellPart part_;
};

/// Adds what one scan has in a band, a few patches at a time.
void add_band(const PointCloud& cloud, std::span<const PointRun> runs,
              const CellBuildOptions& options, std::span<PatchSums> band) {
  BandPoints band_points;
  band_points.sort(cloud, runs);
  std::array<PatchPoints, kPatchesAFit> points;
  std::array<PatchSums*, kPatchesAFit> patches;
  std::size_t used = 0;
  const auto flush = [&] {
    add_scan(std::span(points).first(used), options, std::span(patches).first(used));
    used = 0;
  };
  for (std::size_t i = 0; i < band.size(); ++i) {
    points[used] = band_points.of(i);
    if (points[used].size() == 0) continue;
    points[used].keep(points[used].size());
    patches[used] = &band[i];
    if (++used == kPatchesAFit) flush();
  }
  flush();
}

/// The planes of one band from what was kept of its patches; none has been hit where it is empty.
CellPart fit_sums(std::span<const PatchSums> band, std::uint32_t first_patch,
                  const PlaneRules& rules) {
  CellPart part;
  std::vector<PatchExtent> extents;
  std::vector<MomentsAbout> moments;
  for (std::size_t i = 0; i < band.size(); ++i) {
    const PatchSums& patch = band[i];
    if (patch.points() == 0 || !rules.has_enough_points(patch.points(), part)) continue;
    if (patch.ranges.has_gap()) {
      rules.reject_gap(part);
      continue;
    }
    extents.push_back({first_patch + static_cast<std::uint32_t>(i), patch.points(),
                       patch.ranges.least_m(), patch.ranges.most_m()});
    moments.push_back({patch.origin, patch.sums.back()});
  }
  std::vector<std::optional<FittedPlane>> planes(moments.size());
  fit_planes(moments, planes);
  for (std::size_t k = 0; k < planes.size(); ++k) rules.judge(extents[k], planes[k], part);
  return part;
}

}  // namespace

struct CellBuilder::Impl {
  const Lattice& lattice;
  const CellBuildOptions options;
  const PlaneRules rules{lattice, options};
  std::size_t scans_seen = 0;
  RunParts parts{};
  std::vector<std::vector<PatchSums>> sums{bands_of(lattice)};  // kStreaming, by band

  void update(const LocalMap& local_map) {
    for (; scans_seen < local_map.scan_ends().size(); ++scans_seen) {
      const std::size_t begin = scans_seen == 0 ? 0 : local_map.scan_ends()[scans_seen - 1];
      append_runs(local_map.points(), begin, local_map.scan_ends()[scans_seen], lattice,
                  options.threads, parts);
      if (options.fit == PlaneFit::kStreaming) add_sums(local_map.points());
    }
  }

  /// What was kept of the points is enough: their runs are forgotten.
  void add_sums(const PointCloud& cloud) {
    const BandedRuns banded = sort_by_band(parts, sums.size(), options.threads);
    parallel_for(sums.size(), 1, options.threads, [&](std::size_t band, std::size_t) {
      if (banded.of(band).empty()) return;
      sums[band].resize(kPatchesABand);
      add_band(cloud, banded.of(band), options, sums[band]);
    });
    parts.clear();
  }

  CellPart fit(const PointCloud& cloud) const {
    const BandedRuns banded = sort_by_band(parts, sums.size(), options.threads);
    std::vector<CellPart> bands(sums.size());
    parallel_for(bands.size(), 1, options.threads, [&](std::size_t band, std::size_t) {
      const auto first_patch = static_cast<std::uint32_t>(band * kPatchesABand);
      bands[band] = options.fit == PlaneFit::kStreaming
                        ? fit_sums(sums[band], first_patch, rules)
                        : BandFit(cloud, rules, options).fit(banded.of(band), first_patch);
    });
    CellPart all;
    for (const CellPart& band : bands) all.append(band);
    return all;
  }
};

CellBuilder::CellBuilder(const Lattice& lattice, const CellBuildOptions& options) {
  options.validate();
  impl_.reset(new Impl{lattice, options});
}

CellBuilder::~CellBuilder() = default;
CellBuilder::CellBuilder(CellBuilder&&) noexcept = default;
CellBuilder& CellBuilder::operator=(CellBuilder&&) noexcept = default;

void CellBuilder::update(const LocalMap& local_map) { impl_->update(local_map); }

Cell CellBuilder::finish(const LocalMap& local_map) {
  update(local_map);
  CellPart content = impl_->fit(local_map.points());
  Cell cell;
  cell.lattice = impl_->lattice.spec();
  cell.indices = std::move(content.indices);
  cell.planes = std::move(content.planes);
  cell.statistics = content.statistics;
  cell.T_odom_cell = local_map.T_odom_cell();
  cell.first_stamp = local_map.scans().front().stamp;
  cell.last_stamp = local_map.scans().back().stamp;
  cell.first_scan = local_map.first_scan();
  cell.scan_count = static_cast<std::uint32_t>(local_map.scans().size());
  return cell;
}

}  // namespace cellmap
