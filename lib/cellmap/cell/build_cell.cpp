#include "cellmap/cell/build_cell.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "cellmap/cell/plane_fit.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/parallel.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kPointsAChunk = 16'384;
constexpr std::size_t kPatchesAChunk = 1'024;

void require(bool holds, const char* rule, double value) {
  if (!holds) {
    throw Error(ErrorCode::kInvalidArgument,
                std::string("CELL building needs ") + rule + "; given is " + std::to_string(value));
  }
}

/// The points of a local map sorted by patch: those of patch i are points[begin[i], begin[i + 1]).
struct SegmentedPoints {
  std::vector<PatchPoint> points;
  std::vector<std::uint32_t> begin;

  std::span<PatchPoint> of(std::uint32_t patch) {
    return std::span(points).subspan(begin[patch], begin[patch + 1] - begin[patch]);
  }
};

/// Paper, Sec. III-B, step 2, as a counting sort: points keep their order within a patch.
SegmentedPoints segment(const PointCloud& cloud, const Lattice& lattice, int threads) {
  const std::uint32_t nowhere = lattice.size();  // a point at the origin has no direction
  std::vector<std::uint32_t> patch(cloud.size());
  parallel_for(cloud.size(), kPointsAChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector3d p = cloud[i].cast<double>();
      const double range2 = p.squaredNorm();
      patch[i] = range2 > 0 && std::isfinite(range2) ? lattice.nearest(p) : nowhere;
    }
  });

  SegmentedPoints segmented;
  segmented.begin.assign(lattice.size() + 2, 0);
  for (const std::uint32_t i : patch) ++segmented.begin[i + 1];
  for (std::uint32_t i = 0; i <= nowhere; ++i) segmented.begin[i + 1] += segmented.begin[i];
  std::vector<std::uint32_t> next(segmented.begin.begin(), segmented.begin.end() - 1);
  segmented.points.resize(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) segmented.points[next[patch[i]]++] = cloud[i];
  return segmented;
}

struct RangeSpan {
  double min_m, max_m;
  bool has_gap;
};

/// The ranges of a patch and whether two neighbours among the sorted ones are too far apart.
RangeSpan range_span(std::span<const PatchPoint> points, double max_gap_m,
                     std::vector<double>& ranges) {
  ranges.clear();
  for (const PatchPoint& p : points) ranges.push_back(std::sqrt(p.cast<double>().squaredNorm()));
  const auto [min, max] = std::minmax_element(ranges.begin(), ranges.end());
  RangeSpan span{*min, *max, false};
  if (span.max_m - span.min_m <= max_gap_m) return span;
  std::sort(ranges.begin(), ranges.end());
  for (std::size_t i = 1; i < ranges.size(); ++i) {
    if (ranges[i] - ranges[i - 1] > max_gap_m) span.has_gap = true;
  }
  return span;
}

enum class Outcome : std::uint8_t { kEmpty, kPlane, kFewPoints, kGap, kPlanarity, kGrazing };

struct Patch {
  Outcome outcome = Outcome::kEmpty;
  Plane plane;
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
                  const CellBuildOptions& options, std::vector<double>& scratch) {
  if (points.empty()) return {};
  if (points.size() < options.min_points) return {Outcome::kFewPoints, {}};
  const RangeSpan span = range_span(points, options.max_range_gap_m, scratch);
  if (span.has_gap) return {Outcome::kGap, {}};

  const std::optional<FittedPlane> fitted = options.fit == PlaneFit::kTrimmed
                                                ? fit_plane_trimmed(points, options)
                                                : fit_plane_ransac(points, options, index);
  if (!fitted || fitted->points < options.min_points || !is_planar(*fitted, options)) {
    return {Outcome::kPlanarity, {}};
  }

  const Eigen::Vector3d direction = lattice.direction(index);
  Eigen::Vector3d normal = fitted->normal;
  if (normal.dot(direction) > 0) normal = -normal;
  const double towards = -normal.dot(direction);  // sine of the grazing angle
  const double min_towards = std::sin(options.min_grazing_angle_deg * std::numbers::pi / 180);
  if (!(towards > min_towards)) return {Outcome::kGrazing, {}};
  const double distance = -normal.dot(fitted->centroid) / towards;
  if (!(distance >= span.min_m - options.range_margin_m && distance > 0 &&
        distance <= span.max_m + options.range_margin_m)) {
    return {Outcome::kGrazing, {}};
  }
  const Eigen::Vector3f n = normal.cast<float>();
  return {Outcome::kPlane, {static_cast<float>(distance), n.x(), n.y(), n.z()}};
}

void count(const Patch& patch, std::size_t points, CellStatistics& statistics) {
  statistics.points += points;
  statistics.patches_hit += patch.outcome != Outcome::kEmpty;
  switch (patch.outcome) {
    case Outcome::kEmpty:
      break;
    case Outcome::kPlane:
      statistics.points_in_planes += points;
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
  SegmentedPoints segmented = segment(local_map.points(), lattice, options.threads);
  std::vector<Patch> patches(lattice.size());
  parallel_for(patches.size(), kPatchesAChunk, options.threads,
               [&](std::size_t begin, std::size_t end) {
                 std::vector<double> scratch;
                 for (std::size_t i = begin; i < end; ++i) {
                   const auto index = static_cast<std::uint32_t>(i);
                   patches[i] = build_patch(segmented.of(index), index, lattice, options, scratch);
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
    count(patches[i], segmented.of(i).size(), cell.statistics);
    if (patches[i].outcome != Outcome::kPlane) continue;
    cell.indices.push_back(i);
    cell.planes.push_back(patches[i].plane);
  }
  return cell;
}

}  // namespace cellmap
