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
  double error_m = 0, error_deg = 0;
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

const PlacedCell& nearest_cell(const std::vector<PlacedCell>& cells, const Eigen::Vector3d& p) {
  return *std::min_element(cells.begin(), cells.end(), [&](const auto& a, const auto& b) {
    return (a.T_map_cell.translation() - p).squaredNorm() <
           (b.T_map_cell.translation() - p).squaredNorm();
  });
}

/// The pose found, in the map frame; none where the registration did not converge.
std::optional<Pose> found_pose(const DecodedMap& map, const std::optional<PointTarget>& points,
                               const PointCloud& scan, const Pose& T_map_start) {
  const RegistrationOptions options = registration_options();
  if (points) {
    const RegistrationResult result = register_to_points(*points, scan, T_map_start, options);
    if (!result.converged) return std::nullopt;
    return result.T_target_source;
  }
  const PlacedCell& placed = nearest_cell(map.cells, T_map_start.translation());
  const RegistrationResult result =
      register_scan(*placed.target, scan, placed.T_map_cell.inverse() * T_map_start, options);
  if (!result.converged) return std::nullopt;
  return placed.T_map_cell * result.T_target_source;
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
  PointCloud thin = voxel_means(map.points, options.thin_m);
  // A cloud that is no denser stays as it was read.
  const bool is_denser = thin.size() < map.points.size() / 2;
  return PointTarget(is_denser ? std::move(thin) : map.points, {}, options.threads);
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
      const PointCloud scan = every_nth(
          held.scan.points, std::max<std::size_t>(1, size / options.registration_points));
      const auto found = found_pose(map, points, scan, held.T_map_scan * start_error(k, options));
      if (!found) {
        outcomes[k].failed = true;
        continue;
      }
      const Pose off = held.T_map_scan.inverse() * *found;
      outcomes[k].error_m = off.translation().norm();
      outcomes[k].error_deg = angle_between_rad(off, Pose::Identity()) * 180 / std::numbers::pi;
      outcomes[k].failed = outcomes[k].error_m > options.failed_m;
    }
  });
  HeldBackErrors errors;
  std::vector<double> error_m, error_deg;
  for (const Outcome& outcome : outcomes) {
    ++errors.registrations;
    errors.failed += outcome.failed;
    if (outcome.failed) continue;
    error_m.push_back(outcome.error_m);
    error_deg.push_back(outcome.error_deg);
  }
  errors.median_m = median(std::move(error_m));
  errors.median_deg = median(std::move(error_deg));
  return errors;
}

}  // namespace cellmap
