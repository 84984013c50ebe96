#include "client/cli/simulated_days.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/pipeline/front_end.hpp"
#include "cellmap/simulation/random.hpp"

namespace cellmap::cli {
namespace {

/// Three scans a CELL, and CELLs 6.45 m apart: on KITTI 00 they are, on average.
constexpr double kSpacingM = 2.15;
constexpr std::uint64_t kSecondDaySeed = 77, kPoseErrors = 99;

SimulatorOptions drive_of(const TwoDays& days, bool second) {
  SimulatorOptions options;
  options.route = days.route;
  options.lidar = LidarModel::by_name(days.lidar);
  options.seed = days.seed;
  options.threads = days.threads;
  options.spacing_m = kSpacingM;
  if (days.length_m > 0) {
    options.scans = static_cast<std::size_t>(std::max(2.0, days.length_m / kSpacingM));
  }
  if (second) {
    options.traffic_seed = days.seed + kSecondDaySeed;
    options.lateral_offset_m = days.lateral_offset_m;
  }
  return options;
}

Pose pose_error(const TwoDays& days, CellId cell) {
  simulation::Random random(
      simulation::sub_seed(simulation::sub_seed(days.seed, kPoseErrors), cell.value));
  Tangent xi;
  for (int axis = 0; axis < 6; ++axis) {
    const double sigma =
        axis < 3 ? days.pose_error_m : days.pose_error_deg * std::numbers::pi / 180;
    xi[axis] = sigma * random.normal();
  }
  return exp(xi);
}

/// CELLs of a drive, numbered from `first_id`; `displaced`: not quite where they were.
SimulatedDay drive(const TwoDays& days, bool second, std::uint32_t first_id,
                   const std::shared_ptr<const Lattice>& lattice, const std::stop_token& stop,
                   const ProgressCallback& progress) {
  const SimulatorOptions options = drive_of(days, second);
  SimulatedDay day{SceneTruth(options), {}, {}};
  MapperOptions mapper;
  mapper.build.threads = days.threads;
  FrontEnd front_end(mapper, second ? "later" : "earlier", lattice);
  const auto keep = [&](std::optional<FinishedCell> cell) {
    if (!cell) return;
    const CellId id{first_id + static_cast<std::uint32_t>(day.cells.size())};
    const Pose T_world_cell = day.truth.T_world_sensor(cell->cell().first_scan);
    const Pose error = second ? pose_error(days, id) : Pose::Identity();
    day.cells.push_back({id, T_world_cell * error});
    day.targets.emplace(id, cell->target);
  };
  const auto source = simulate(options);
  const std::size_t before = second ? source->size() : 0;
  while (const auto scan = source->next()) {
    throw_if_stopped(stop);
    keep(front_end.add(*scan));
    if (progress) progress({before + scan->index + 1, 2 * source->size(), day.cells.size()});
  }
  keep(front_end.finish());
  return day;
}

/// Which points any of the compared CELLs of the other day has in free sight.
std::vector<bool> in_sight_of(const SimulatedDay& other, const std::vector<CellId>& looking,
                              const std::vector<Eigen::Vector3d>& points, double max_range_m) {
  std::vector<bool> seen(points.size(), false);
  for (const CellId cell : looking) {
    const Pose& T_world_cell = other.T_world_cell(cell);
    const std::vector<bool> now = other.truth.in_sight(T_world_cell, points);
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (now[i] && (points[i] - T_world_cell.translation()).norm() <= max_range_m) seen[i] = true;
    }
  }
  return seen;
}

/// What the truth says of the patches of a CELL.
struct PatchTruth {
  std::vector<bool> changed, in_sight;
};

PatchTruth truth_of(const SimulatedDay& day, const PlacedCell& placed, const SimulatedDay& other,
                    const DiffOptions& options) {
  /// On a vehicle, and away from what the other day has: odometry errors within a CELL and planes
  /// that average round shapes leave patches beside the surfaces that they are of.
  constexpr double kOnVehicle_m = 0.3, kAway_m = 0.3;
  const Cell& cell = day.targets.at(placed.id)->cell();
  const std::vector<Eigen::Vector3d> patches = day.patches_of(placed.id);
  const std::vector<double> to_vehicle_m =
      day.truth.to_vehicles_m(patches, cell.first_scan, cell.scan_count);
  PatchTruth truth{std::vector<bool>(patches.size(), false), {}};
  for (std::size_t i = 0; i < patches.size(); ++i) {
    truth.changed[i] =
        to_vehicle_m[i] <= kOnVehicle_m && other.truth.to_standing_m(patches[i]) > kAway_m;
  }
  std::vector<CellId> looking;
  for (const CellPair& pair : pairs_to_compare(std::span(&placed, 1), other.cells, options)) {
    looking.push_back(other.cells[pair.later].id);
  }
  truth.in_sight = in_sight_of(other, looking, patches, options.max_range_m);
  return truth;
}

}  // namespace

void ChangeCount::add(const ChangeCount& other) {
  patches += other.patches;
  never_seen += other.never_seen;
  claimed += other.claimed;
  right += other.right;
  in_sight += other.in_sight;
  found += other.found;
}

ChangeCount ChangeScore::total() const {
  ChangeCount sum;
  for (const ChangeCount& count : by_range) sum.add(count);
  return sum;
}

std::vector<Eigen::Vector3d> SimulatedDay::patches_of(CellId id) const {
  const RegistrationTarget& target = *targets.at(id);
  std::vector<Eigen::Vector3d> patches;
  for (std::size_t i = 0; i < target.cell().planes.size(); ++i) {
    patches.push_back(T_world_cell(id) * (static_cast<double>(target.cell().planes[i].distance_m) *
                                          target.lattice().direction(target.cell().indices[i])));
  }
  return patches;
}

const Pose& SimulatedDay::T_world_cell(CellId id) const {
  return truth.T_world_sensor(targets.at(id)->cell().first_scan);
}

TargetProvider SimulatedDays::targets() const {
  return [this](CellId id) {
    const auto found = earlier.targets.find(id);
    return found != earlier.targets.end() ? found->second : later.targets.at(id);
  };
}

SimulatedDays simulate_two_days(const TwoDays& days, const std::stop_token& stop,
                                const ProgressCallback& progress) {
  const auto lattice =
      std::make_shared<const Lattice>(LatticeSpec{LatticeKind::kFibonacci, days.lattice_size});
  SimulatedDay earlier = drive(days, false, 1, lattice, stop, progress);
  const auto next = static_cast<std::uint32_t>(earlier.cells.size()) + 1;
  SimulatedDay later = drive(days, true, next, lattice, stop, progress);
  return {std::move(earlier), std::move(later)};
}

ChangeScore score_changes(const SimulatedDay& day, const std::vector<CellDiff>& diffs,
                          const SimulatedDay& other, const DiffOptions& options) {
  ChangeScore score;
  score.by_range.resize(
      static_cast<std::size_t>(std::ceil(options.max_range_m / ChangeScore::kStep_m)));
  for (std::size_t k = 0; k < day.cells.size(); ++k) {
    const Cell& cell = day.targets.at(day.cells[k].id)->cell();
    const PatchTruth truth = truth_of(day, day.cells[k], other, options);
    for (std::size_t i = 0; i < cell.planes.size(); ++i) {
      const auto bin = static_cast<std::size_t>(cell.planes[i].distance_m / ChangeScore::kStep_m);
      if (bin >= score.by_range.size()) continue;
      const PatchChange change = diffs[k].patches[i];
      const bool claimed = change == PatchChange::kVanished || change == PatchChange::kAppeared;
      ChangeCount& count = score.by_range[bin];
      ++count.patches;
      count.never_seen += change == PatchChange::kNeverSeen;
      count.claimed += claimed;
      count.right += claimed && truth.changed[i];
      count.in_sight += truth.changed[i] && truth.in_sight[i];
      count.found += claimed && truth.changed[i] && truth.in_sight[i];
    }
  }
  return score;
}

}  // namespace cellmap::cli
