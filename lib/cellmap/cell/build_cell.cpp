#include "cellmap/cell/build_cell.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "cellmap/cell/plane_fit.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kPointsAChunk = 16'384;
constexpr std::size_t kPatchesAChunk = 512;

void require(bool holds, const char* rule, double value) {
  if (!holds) {
    throw Error(ErrorCode::kInvalidArgument,
                std::string("CELL building needs ") + rule + "; given is " + std::to_string(value));
  }
}

/// The points of a local map sorted by band of kPatchesAChunk neighbouring lattice points: those of
/// band b are points[begin[b], begin[b + 1]). Sorting by patch in one go would write to as many
/// places as there are patches, more than the caches hold.
struct BandedPoints {
  std::unique_ptr<PatchPoint[]> points;
  std::vector<std::uint32_t> begin;

  std::span<const PatchPoint> of(std::size_t band) const {
    return {points.get() + begin[band], begin[band + 1] - begin[band]};
  }
};

/// The lattice point nearest to each point; `lattice.size()` where a point has no direction.
std::vector<std::uint32_t> patches_of(const PointCloud& cloud, const Lattice& lattice,
                                      int threads) {
  std::vector<std::uint32_t> patch(cloud.size());
  parallel_for(cloud.size(), kPointsAChunk, threads, [&](std::size_t begin, std::size_t end) {
    const auto part = std::span(patch).subspan(begin, end - begin);
    lattice.nearest(cloud.x.data() + begin, cloud.y.data() + begin, cloud.z.data() + begin, part);
    for (std::uint32_t& i : part) i = std::min(i, lattice.size());
  });
  return patch;
}

/// Paper, Sec. III-B, step 2, first half: a counting sort by band that keeps the order of points,
/// however many parts the cloud is counted in.
BandedPoints sort_by_band(const PointCloud& cloud, const Lattice& lattice, int threads) {
  const std::vector<std::uint32_t> patch = patches_of(cloud, lattice, threads);
  const std::size_t parts = threads == 1 ? 1 : 8;
  const std::size_t part_size = std::max<std::size_t>(1, (cloud.size() + parts - 1) / parts);
  const std::size_t bands = lattice.size() / kPatchesAChunk + 1;  // "nowhere" is in the last one
  std::vector<std::uint32_t> next(parts * bands, 0);
  parallel_for(cloud.size(), part_size, threads, [&](std::size_t begin, std::size_t end) {
    std::uint32_t* const count = next.data() + begin / part_size * bands;
    for (std::size_t i = begin; i < end; ++i) ++count[patch[i] / kPatchesAChunk];
  });

  BandedPoints banded;
  std::uint32_t position = 0;
  for (std::size_t band = 0; band < bands; ++band) {
    banded.begin.push_back(position);
    for (std::size_t part = 0; part < parts; ++part) {
      position += std::exchange(next[part * bands + band], position);
    }
  }
  banded.begin.push_back(position);
  banded.points = std::make_unique_for_overwrite<PatchPoint[]>(position);
  parallel_for(cloud.size(), part_size, threads, [&](std::size_t begin, std::size_t end) {
    std::uint32_t* const at = next.data() + begin / part_size * bands;
    for (std::size_t i = begin; i < end; ++i) {
      banded.points[at[patch[i] / kPatchesAChunk]++] = {cloud.x[i], cloud.y[i], cloud.z[i],
                                                        patch[i]};
    }
  });
  return banded;
}

/// What patches are worked on in, reused from one to the next.
struct Workspace {
  std::vector<PatchPoint> points;  // of one band, sorted by patch
  std::vector<std::uint32_t> begin;
  CentredPatch patch;
  std::vector<double> least, most;

  std::span<PatchPoint> of(std::size_t patch_in_band) {
    return std::span(points).subspan(begin[patch_in_band],
                                     begin[patch_in_band + 1] - begin[patch_in_band]);
  }
};

/// Paper, Sec. III-B, step 2, second half: the points of one band, still in order, by patch.
void sort_by_patch(std::span<const PatchPoint> band, std::size_t first_patch, Workspace& work) {
  work.begin.assign(kPatchesAChunk + 2, 0);
  for (const PatchPoint& p : band) ++work.begin[p.patch - first_patch + 2];
  for (std::size_t i = 2; i < work.begin.size(); ++i) work.begin[i] += work.begin[i - 1];
  if (work.points.size() < band.size()) work.points.resize(band.size());
  for (const PatchPoint& p : band) work.points[work.begin[p.patch - first_patch + 1]++] = p;
}

/// The largest difference between neighbours among the sorted ranges, in linear time: of n points
/// some two neighbours are at least span / (n - 1) apart, so the largest gap is never within one of
/// n bins of the span.
double largest_gap_m(std::span<const PatchPoint> points, Workspace& work) {
  const double min = work.patch.min_range_m(), max = work.patch.max_range_m();
  work.least.assign(points.size(), HUGE_VAL);
  work.most.assign(points.size(), -HUGE_VAL);
  const double bins_a_metre = static_cast<double>(points.size()) / (max - min);
  for (const PatchPoint& p : points) {
    const double range = std::sqrt(position(p).squaredNorm());
    const auto bin = std::min(points.size() - 1,
                              static_cast<std::size_t>(std::max(0.0, range - min) * bins_a_metre));
    work.least[bin] = std::min(work.least[bin], range);
    work.most[bin] = std::max(work.most[bin], range);
  }
  double gap = 0, last = min;
  for (std::size_t bin = 0; bin < points.size(); ++bin) {
    if (work.least[bin] > work.most[bin]) continue;  // empty
    gap = std::max(gap, work.least[bin] - last);
    last = work.most[bin];
  }
  return gap;
}

/// Whether two neighbours among the sorted ranges are too far apart.
bool has_gap(std::span<const PatchPoint> points, double max_gap_m, Workspace& work) {
  return work.patch.max_range_m() - work.patch.min_range_m() > max_gap_m &&
         largest_gap_m(points, work) > max_gap_m;
}

enum class Outcome : std::uint8_t { kEmpty, kPlane, kFewPoints, kGap, kPlanarity, kGrazing };

struct Patch {
  Outcome outcome = Outcome::kEmpty;
  Plane plane{};
  std::uint32_t points = 0;
};

bool is_planar(const FittedPlane& fitted, const CellBuildOptions& options) {
  const double max_rms2 = options.max_plane_rms_m * options.max_plane_rms_m;
  const double max_tangent = std::tan(options.max_normal_error_deg * std::numbers::pi / 180);
  const double leverage = static_cast<double>(fitted.points) * fitted.variance_within_m2;
  return fitted.variance_across_m2 <= max_tangent * max_tangent * leverage &&
         (options.max_plane_rms_m == 0 || fitted.variance_across_m2 <= max_rms2) &&
         fitted.variance_across_m2 <= options.max_thickness_ratio * fitted.variance_within_m2;
}

/// Paper, Sec. III-B, steps 3 and 4, for one patch.
Patch build_patch(std::span<PatchPoint> points, std::uint32_t index, const Lattice& lattice,
                  const CellBuildOptions& options, Workspace& work) {
  const auto count = static_cast<std::uint32_t>(points.size());
  const auto rejected = [count](Outcome outcome) { return Patch{outcome, {}, count}; };
  if (points.empty()) return {};
  if (count < options.min_points) return rejected(Outcome::kFewPoints);
  work.patch.assign(points);
  if (has_gap(points, options.max_range_gap_m, work)) return rejected(Outcome::kGap);

  const std::optional<FittedPlane> fitted = options.fit == PlaneFit::kTrimmed
                                                ? fit_plane_trimmed(work.patch, options)
                                                : fit_plane_ransac(points, options, index);
  if (!fitted || fitted->points < options.min_points || !is_planar(*fitted, options)) {
    return rejected(Outcome::kPlanarity);
  }

  const Eigen::Vector3d direction = lattice.direction(index);
  Eigen::Vector3d normal = fitted->normal;
  if (normal.dot(direction) > 0) normal = -normal;
  const double towards = -normal.dot(direction);  // sine of the grazing angle
  const double min_towards = std::sin(options.min_grazing_angle_deg * std::numbers::pi / 180);
  if (!(towards > min_towards)) return rejected(Outcome::kGrazing);
  const double distance = -normal.dot(fitted->centroid) / towards;
  if (!(distance >= work.patch.min_range_m() - options.range_margin_m && distance > 0 &&
        distance <= work.patch.max_range_m() + options.range_margin_m)) {
    return rejected(Outcome::kGrazing);
  }
  const Eigen::Vector3f n = normal.cast<float>();
  return {Outcome::kPlane, {static_cast<float>(distance), n.x(), n.y(), n.z()}, count};
}

void count(const Patch& patch, CellStatistics& statistics) {
  statistics.points += patch.points;
  statistics.patches_hit += patch.outcome != Outcome::kEmpty;
  switch (patch.outcome) {
    case Outcome::kEmpty:
      break;
    case Outcome::kPlane:
      statistics.points_in_planes += patch.points;
      break;
    case Outcome::kFewPoints:
      ++statistics.rejected_few_points;
      break;
    case Outcome::kGap:
      ++statistics.rejected_gap;
      break;
    case Outcome::kPlanarity:
      ++statistics.rejected_planarity;
      break;
    case Outcome::kGrazing:
      ++statistics.rejected_grazing;
      break;
  }
}

}  // namespace

void CellBuildOptions::validate() const {
  require(max_range_gap_m > 0 && max_range_gap_m <= 1000, "0 < max_range_gap_m <= 1000",
          max_range_gap_m);
  require(min_points >= 3 && min_points <= 1'000'000, "3 <= min_points <= 1000000", min_points);
  require(max_plane_rms_m >= 0 && max_plane_rms_m <= 100, "0 <= max_plane_rms_m <= 100",
          max_plane_rms_m);
  require(max_thickness_ratio > 0 && max_thickness_ratio <= 1, "0 < max_thickness_ratio <= 1",
          max_thickness_ratio);
  require(max_normal_error_deg > 0 && max_normal_error_deg <= 90, "0 < max_normal_error_deg <= 90",
          max_normal_error_deg);
  require(min_grazing_angle_deg >= 0 && min_grazing_angle_deg < 90,
          "0 <= min_grazing_angle_deg < 90", min_grazing_angle_deg);
  require(range_margin_m >= 0 && range_margin_m <= 1000, "0 <= range_margin_m <= 1000",
          range_margin_m);
  require(trim_rms_factor >= 1 && trim_rms_factor <= 100, "1 <= trim_rms_factor <= 100",
          trim_rms_factor);
  require(ransac_draws >= 1 && ransac_draws <= 10'000, "1 <= ransac_draws <= 10000", ransac_draws);
  require(ransac_inlier_m > 0 && ransac_inlier_m <= 10, "0 < ransac_inlier_m <= 10",
          ransac_inlier_m);
  require(threads >= 0, "threads >= 0", threads);
}

Cell build_cell(const LocalMap& local_map, const Lattice& lattice,
                const CellBuildOptions& options) {
  options.validate();
  const BandedPoints banded = sort_by_band(local_map.points(), lattice, options.threads);
  std::vector<Patch> patches(lattice.size());
  parallel_for(patches.size(), kPatchesAChunk, options.threads,
               [&](std::size_t begin, std::size_t end) {
                 Workspace work;
                 sort_by_patch(banded.of(begin / kPatchesAChunk), begin, work);
                 for (std::size_t i = begin; i < end; ++i) {
                   patches[i] = build_patch(work.of(i - begin), static_cast<std::uint32_t>(i),
                                            lattice, options, work);
                 }
               });

  Cell cell;
  cell.lattice = lattice.spec();
  cell.T_odom_cell = local_map.T_odom_cell();
  cell.first_stamp = local_map.scans().front().stamp;
  cell.last_stamp = local_map.scans().back().stamp;
  cell.first_scan = local_map.first_scan();
  cell.scan_count = static_cast<std::uint32_t>(local_map.scans().size());
  for (std::uint32_t i = 0; i < lattice.size(); ++i) {
    count(patches[i], cell.statistics);
    if (patches[i].outcome != Outcome::kPlane) continue;
    cell.indices.push_back(i);
    cell.planes.push_back(patches[i].plane);
  }
  return cell;
}

}  // namespace cellmap
