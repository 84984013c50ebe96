#include "cellmap/evaluation/held_back_registration.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "cellmap/core/parallel.hpp"
#include "cellmap/evaluation/point_registration.hpp"

namespace cellmap {
namespace {

/// Far from the answer a few thousand points say the same as all.
constexpr std::size_t kCoarsePoints = 5'000;

struct Outcome {
  double points_m = 0, origin_m = 0, turn_deg = 0;
  bool failed = false;
};

/// Scatters neighbouring numbers over [0, 1): the finaliser of SplitMix64.
double uniform(std::uint64_t x) {
  x = (x + 1) * 0x9e3779b97f4a7c15u;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
  return static_cast<double>((x ^ (x >> 31)) >> 11) * 0x1p-53;
}

/// A displacement of exactly the two lengths, level in translation and about the vertical axis: the
/// error of an odometry.
Pose start_error(std::uint64_t number, const ComparisonOptions& options) {
  const double angle = 2 * std::numbers::pi * uniform(options.seed * 1'000'003 + 2 * number);
  const bool left = uniform(options.seed * 1'000'003 + 2 * number + 1) < 0.5;
  Pose error = Pose::Identity();
  error.translation() << options.start_error_m * std::cos(angle),
      options.start_error_m * std::sin(angle), 0;
  error.rotate(Eigen::AngleAxisd((left ? 1 : -1) * options.start_error_deg * std::numbers::pi / 180,
                                 Eigen::Vector3d::UnitZ()));
  return error;
}

RegistrationOptions registration_options() {
  RegistrationOptions registration;
  registration.stages = default_registration_stages();
  for (std::size_t s = 0; s + 1 < registration.stages.size(); ++s) {
    registration.stages[s].max_points = kCoarsePoints;
  }
  registration.judge = false;
  return registration;
}

const ReadCell& nearest_cell(const std::vector<ReadCell>& cells, const Eigen::Vector3d& p) {
  return *std::min_element(cells.begin(), cells.end(), [&](const auto& a, const auto& b) {
    return (a.T_map_cell.translation() - p).squaredNorm() <
           (b.T_map_cell.translation() - p).squaredNorm();
  });
}

/// The pose found, in the map frame.
Pose found_pose(const DecodedMap& map, const std::optional<PointTarget>& points,
                const PointCloud& scan, const Pose& T_map_start) {
  const RegistrationOptions options = registration_options();
  if (points) return register_to_points(*points, scan, T_map_start, options).T_target_source;
  const ReadCell& placed = nearest_cell(map.cells, T_map_start.translation());
  const Pose T_cell_start = placed.T_map_cell.inverse() * T_map_start;
  return placed.T_map_cell *
         register_scan(*placed.target, scan, T_cell_start, options).T_target_source;
}

/// `off`: from where the scan is to where it was found, scan frame.
Outcome outcome_of(const PointCloud& scan, const Pose& off, double failed_m) {
  Outcome outcome;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Eigen::Vector3d p = scan[i].cast<double>();
    outcome.points_m += (off * p - p).norm();
  }
  outcome.points_m /= static_cast<double>(scan.size());
  outcome.origin_m = off.translation().norm();
  outcome.turn_deg = angle_between_rad(off, Pose::Identity()) * 180 / std::numbers::pi;
  outcome.failed = !(outcome.points_m <= failed_m);
  return outcome;
}

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// What scans are registered to where there are no CELLs.
std::optional<PointTarget> point_target(const DecodedMap& map, const ComparisonOptions& options) {
  if (!map.cells.empty()) return std::nullopt;
  if (!map.normals.empty()) return PointTarget(map.points, map.normals, options.threads);
  const PointCloud thin = voxel_means(map.points, options.thin_m);
  // A cloud that is no denser stays as it was read.
  const bool is_denser = thin.size() < map.points.size() / 2;
  return PointTarget(is_denser ? thin : map.points, {}, options.threads);
}

}  // namespace

HeldBackErrors register_held_back(const ComparedDrive& drive, const DecodedMap& map,
                                  const ComparisonOptions& options) {
  const std::optional<PointTarget> points = point_target(map, options);
  std::vector<Outcome> outcomes(drive.held_back.size() * options.starts);
  parallel_for(outcomes.size(), 1, options.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin; k < end; ++k) {
      const PlacedScan& held = drive.held_back[k / options.starts];
      const std::size_t size = held.scan.points.size();
      const PointCloud scan =
          every_nth(held.scan.points, std::max<std::size_t>(1, size / options.registration_points));
      const Pose found = found_pose(map, points, scan, held.T_map_scan * start_error(k, options));
      outcomes[k] = outcome_of(scan, held.T_map_scan.inverse() * found, options.failed_m);
    }
  });
  HeldBackErrors errors;
  std::vector<double> points_m, origin_m, turn_deg;
  for (const Outcome& outcome : outcomes) {
    ++errors.registrations;
    errors.failed += outcome.failed;
    if (outcome.failed) continue;
    points_m.push_back(outcome.points_m);
    origin_m.push_back(outcome.origin_m);
    turn_deg.push_back(outcome.turn_deg);
  }
  errors.points_m = median(std::move(points_m));
  errors.origin_m = median(std::move(origin_m));
  errors.turn_deg = median(std::move(turn_deg));
  return errors;
}

}  // namespace cellmap
