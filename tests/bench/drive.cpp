#include "bench/drive.hpp"

#include <cmath>
#include <numbers>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/core/error.hpp"
#include "support/real_data.hpp"

namespace cellmap::bench {
namespace {

constexpr double kCellDistanceM = 6.0;

}  // namespace

std::vector<PosedScan> simulated_scans(std::size_t first, std::size_t count) {
  SimulatorOptions options;
  options.odometry = "truth";
  options.threads = 0;
  const auto source = simulate(options);
  source->seek(first);
  std::vector<PosedScan> scans;
  while (scans.size() < count) {
    auto scan = source->next();
    if (!scan) break;
    scan->index = scans.size();
    scans.push_back(std::move(*scan));
  }
  return scans;
}

std::vector<PosedScan> kitti_scans() {
  const auto folder = test::real_data(kKitti);
  if (!std::filesystem::exists(folder)) return {};
  const auto source = open_dataset(folder);
  std::vector<PosedScan> scans;
  while (auto scan = source->next()) scans.push_back(std::move(*scan));
  return scans;
}

std::optional<Cell> strict_kitti_cell(const Lattice& lattice) {
  constexpr std::size_t kAbout = 5'800;
  const auto folder = test::real_data(kKittiDense);
  if (!std::filesystem::exists(folder)) return std::nullopt;
  DatasetOptions poses;
  poses.poses = "poses_gt.txt";
  const auto source = open_dataset(folder, poses);
  std::vector<PosedScan> scans;
  while (auto scan = source->next()) scans.push_back(std::move(*scan));
  CellBuildOptions options;
  options.max_range_gap_m = 0.2;
  options.min_points = 12;
  std::optional<Cell> nearest;
  const auto off = [](const Cell& cell) {
    return std::abs(static_cast<double>(cell.planes.size()) - double{kAbout});
  };
  for (const LocalMap& local_map : local_maps(scans, false)) {
    Cell cell = build_cell(local_map, lattice, options);
    cell.session = "bench";
    if (!nearest || off(cell) < off(*nearest)) nearest = std::move(cell);
  }
  return nearest;
}

std::filesystem::path kitti00_route() {
  return test::real_data("kitti-trajectories") / "ground_truth" / "00.txt";
}

std::vector<LocalMap> local_maps(const std::vector<PosedScan>& scans, bool keep_last) {
  std::vector<LocalMap> maps;
  for (const PosedScan& raw : scans) {
    Scan scan = filter_scan(raw.points, raw.stamp, {});
    if (maps.empty() || maps.back().is_complete_for(raw.T_odom_sensor, kCellDistanceM)) {
      maps.emplace_back(std::move(scan), raw.T_odom_sensor, static_cast<std::uint32_t>(raw.index));
    } else {
      maps.back().add(scan, raw.T_odom_sensor);
    }
  }
  if (!keep_last && !maps.empty()) maps.pop_back();
  return maps;
}

RegistrationTarget to_target(const LocalMap& local_map, std::shared_ptr<const Lattice> lattice,
                             const std::string& session, std::uint32_t sequence) {
  Cell cell = build_cell(local_map, *lattice, {});
  cell.session = session;
  cell.sequence = sequence;
  return {std::make_shared<const Cell>(std::move(cell)), std::move(lattice)};
}

CellPair make_pair(const std::string& data, const std::vector<PosedScan>& scans,
                   std::shared_ptr<const Lattice> lattice) {
  const std::vector<LocalMap> maps = local_maps(scans, true);
  if (maps.size() < 2) {
    throw Error(
        ErrorCode::kInvalidArgument,
        "the scans of " + data + " must make two CELLs, found " + std::to_string(maps.size()));
  }
  return {data,
          lattice,
          maps[0],
          maps[1],
          to_target(maps[0], lattice, "bench", 0),
          to_target(maps[1], lattice, "bench", 1),
          maps[0].T_odom_cell().inverse() * maps[1].T_odom_cell()};
}

Pose CellPair::guess() const {
  Tangent off = Tangent::Zero();
  off.head<3>() << 0.24, 0.18, 0.0;
  off[5] = std::numbers::pi / 180;
  return exp(off) * T_a_b;
}

}  // namespace cellmap::bench
