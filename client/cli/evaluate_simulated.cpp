#include "client/cli/evaluate_simulated.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/core/error.hpp"
#include "cellmap/simulation/random.hpp"
#include "cellmap/simulation/simulator.hpp"
#include "client/cli/build_in_store.hpp"
#include "client/cli/console.hpp"

namespace cellmap::cli {
namespace {

using simulation::Random;

/// Three scans a CELL, and CELLs 6.45 m apart: on KITTI 00 they are, on average.
constexpr double kMapSpacingM = 2.15;
/// Another seed, and another day.
constexpr std::uint64_t kElsewhere = 1'000'003, kSecondDay = 77;

SimulatorOptions first_drive(const SimulatedTown& town) {
  SimulatorOptions options;
  options.route = town.route;
  options.lidar = LidarModel::by_name(town.lidar);
  options.odometry = "truth";
  options.seed = town.seed;
  options.threads = town.threads;
  options.spacing_m = kMapSpacingM;
  if (town.length_m > 0) {
    options.scans = static_cast<std::size_t>(std::max(2.0, town.length_m / kMapSpacingM));
  }
  return options;
}

/// A stretch of the second drive: every query of it has the same offset and heading.
SimulatorOptions second_drive(const SimulatedTown& town, double lateral_m, double heading_deg) {
  SimulatorOptions options = first_drive(town);
  options.traffic_seed = town.seed + kSecondDay;
  options.lateral_offset_m = lateral_m;
  options.heading_deg = heading_deg;
  options.spacing_m = 1.0;
  options.scans = static_cast<std::size_t>(town.length_m);
  if (!town.query_lidar.empty()) options.lidar = LidarModel::by_name(town.query_lidar);
  return options;
}

std::vector<SimulatorOptions> drives_of(const SimulatedTown& town, const std::string& scenario) {
  std::vector<SimulatorOptions> drives;
  if (scenario == "same_lane" || scenario == "occluded") {
    for (const double lateral_m : {0.0, -0.6, 0.6}) {
      drives.push_back(second_drive(town, lateral_m, 5 * lateral_m));
    }
  } else if (scenario == "other_lane") {
    for (const double turn_deg : {-3.0, 3.0}) {
      drives.push_back(second_drive(town, 3.5, turn_deg));
    }
  } else if (scenario == "opposite_direction") {
    for (const double turn_deg : {177.0, 183.0}) {
      drives.push_back(second_drive(town, 3.5, turn_deg));
    }
  } else if (scenario == "leaning") {
    for (const double turn_deg : {0.0, 70.0, 205.0}) {
      drives.push_back(second_drive(town, 0.3, turn_deg));
      drives.back().lean_deg = 10;
    }
  } else if (scenario == "elsewhere") {
    for (const double turn_deg : {0.0, 90.0}) {
      drives.push_back(second_drive(town, 0, turn_deg));
      drives.back().seed += kElsewhere;
    }
  } else {
    throw Error(ErrorCode::kInvalidArgument, "no simulated scenario is named " + scenario);
  }
  return drives;
}

/// A person or a bush beside the sensor.
struct Clutter {
  double azimuth_rad, range_m, half_width_rad, top_m;
};

/// Puts things around the sensor until they hide `count` of the points.
void hide_behind_clutter(PointCloud& scan, std::size_t count, Random& random) {
  std::size_t hidden = 0;
  for (int tries = 0; hidden < count && tries < 1000; ++tries) {
    const double range_m = random.uniform(3, 15);
    const Clutter thing = {random.uniform(-std::numbers::pi, std::numbers::pi), range_m,
                           random.uniform(0.25, 0.6) / range_m, random.uniform(-0.4, 1.0)};
    for (std::size_t i = 0; i < scan.size() && hidden < count; ++i) {
      const double x = scan.x[i], y = scan.y[i], far_m = std::hypot(x, y);
      if (far_m <= thing.range_m) continue;
      const double turn =
          std::remainder(std::atan2(y, x) - thing.azimuth_rad, 2 * std::numbers::pi);
      const double share = thing.range_m / far_m;
      if (std::abs(turn) > thing.half_width_rad || scan.z[i] * share > thing.top_m) continue;
      scan.x[i] *= static_cast<float>(share);
      scan.y[i] *= static_cast<float>(share);
      scan.z[i] *= static_cast<float>(share);
      ++hidden;
    }
  }
}

PointCloud occluded(const PointCloud& scan, std::uint64_t seed) {
  constexpr double kMissingRad = 2 * std::numbers::pi / 3, kClutterShare = 0.2;
  Random random(seed);
  const double missing_from = random.uniform(-std::numbers::pi, std::numbers::pi);
  PointCloud seen;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    double turn = std::atan2(scan.y[i], scan.x[i]) - missing_from;
    if (turn < 0) turn += 2 * std::numbers::pi;
    if (turn < kMissingRad) continue;
    const bool is_stray = random.chance(kClutterShare / 2);
    const double nearest = std::min(1.0, 2.0 / scan[i].norm());
    seen.push_back(scan[i] * static_cast<float>(is_stray ? random.uniform(nearest, 1.0) : 1.0));
  }
  hide_behind_clutter(seen, static_cast<std::size_t>(0.5 * kClutterShare * seen.size()), random);
  return seen;
}

}  // namespace

std::string build_simulated(Store& store, const SimulatedTown& town, const std::stop_token& stop,
                            const ProgressCallback& progress) {
  const SimulatorOptions drive = first_drive(town);
  const std::string name = format(
      "%s-%zu-%s-%u-%llu",
      town.route == "city" || town.route == "town" ? town.route.c_str() : "file", drive.scans,
      town.lidar.c_str(), town.lattice_size, static_cast<unsigned long long>(town.seed));
  MapperOptions mapper;
  mapper.bidirectional = mapper.loop_closures = false;
  const auto source = simulate(drive);
  build_in_store(store, name, LatticeSpec{LatticeKind::kFibonacci, town.lattice_size}, std::nullopt,
                 "first-drive", *source, mapper, stop, progress);
  return name;
}

std::vector<std::string> simulated_scenarios() {
  return {"same_lane", "other_lane", "opposite_direction", "occluded", "leaning", "elsewhere"};
}

void simulated_queries(const SimulatedTown& town, const std::string& scenario,
                       const std::stop_token& stop,
                       const std::function<void(const KnownQuery&)>& ask) {
  const std::vector<SimulatorOptions> drives = drives_of(town, scenario);
  const std::size_t wanted = scenario == "elsewhere" ? town.elsewhere : town.queries;
  for (std::size_t d = 0; d < drives.size(); ++d) {
    const auto drive = simulate(drives[d]);
    const std::size_t count = wanted / drives.size() + (d < wanted % drives.size());
    for (std::size_t k = 0; k < count; ++k) {
      throw_if_stopped(stop);
      const double share = (static_cast<double>(k) + 0.5) / static_cast<double>(count);
      drive->seek(static_cast<std::size_t>(share * static_cast<double>(drive->size())));
      PosedScan scan = *drive->next();
      if (scenario == "occluded") {
        scan.points = occluded(scan.points, simulation::sub_seed(town.seed + d, scan.index));
      }
      KnownQuery query;
      // The map was built at its true poses: it lies in the world.
      query.T_map_query = drive->ground_truth()[scan.index].pose;
      query.mapped = scenario != "elsewhere";
      query.query = RelocalisationQuery::from_scan(std::move(scan.points));
      ask(query);
    }
  }
}

}  // namespace cellmap::cli
