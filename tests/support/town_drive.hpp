#pragma once

#include <cmath>
#include <fstream>
#include <memory>
#include <numbers>
#include <unordered_map>
#include <vector>

#include "cellmap/pipeline/build_map.hpp"
#include "cellmap/pipeline/front_end.hpp"
#include "cellmap/simulation/simulator.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::test {

/// A short simulated drive: a little more than once around a block, one scan every 1.5 m, seen by a
/// LiDAR that is thin enough for tests.
struct TownDrive {
  double radius_m = 22;
  double laps = 1.2;
  double step_m = 1.5;
  /// Error of the odometry: heading, a metre driven, and length.
  double drift_deg_per_m = 0.05;
  double stretch = 1.01;
  double lateral_offset_m = 0;
  std::uint64_t traffic_seed = 1;
  std::uint64_t seed = 3;

  std::size_t scans() const {
    return static_cast<std::size_t>(laps * 2 * std::numbers::pi * radius_m / step_m);
  }

  std::vector<Pose> truth() const { return circle(0, 1); }
  std::vector<Pose> odometry() const {
    return circle(drift_deg_per_m * std::numbers::pi / 180, stretch);
  }

  std::unique_ptr<ScanSource> open() const {
    TempFolder folder;
    write(folder.path() / "route.txt", truth());
    write(folder.path() / "odometry.txt", odometry());
    SimulatorOptions options;
    options.route = (folder.path() / "route.txt").string();
    options.route_frame = PoseFrame::kSensor;
    options.odometry = (folder.path() / "odometry.txt").string();
    options.seed = seed;
    options.traffic_seed = traffic_seed;
    options.lateral_offset_m = lateral_offset_m;
    options.lidar.columns = 600;
    options.lidar.beams = 40;
    return simulate(options);
  }

 private:
  std::vector<Pose> circle(double drift_rad_per_m, double stretched) const {
    std::vector<Pose> poses = {Pose::Identity()};
    Pose step = Pose::Identity();
    step.translation().x() = step_m * stretched;
    step.rotate(
        Eigen::AngleAxisd(step_m * (1 / radius_m + drift_rad_per_m), Eigen::Vector3d::UnitZ()));
    while (poses.size() < scans()) poses.push_back(poses.back() * step);
    return poses;
  }

  static void write(const std::filesystem::path& file, const std::vector<Pose>& poses) {
    std::vector<StampedPose> stamped;
    for (const Pose& T : poses) {
      stamped.push_back({static_cast<Stamp>(stamped.size()) * 100'000'000, T});
    }
    std::ofstream(file) << to_text(Trajectory(std::move(stamped)), TrajectoryFormat::kKitti);
  }
};

/// A map in memory, as a store would keep it.
struct BuiltMap {
  std::shared_ptr<const Lattice> lattice =
      std::make_shared<const Lattice>(LatticeSpec{LatticeKind::kFibonacci, 20'000});
  std::vector<CellUpdate> updates;
  std::unordered_map<CellId, std::shared_ptr<const RegistrationTarget>> targets;
  PoseGraph graph;

  void add(CellUpdate&& update) {
    targets[update.id] = std::make_shared<const RegistrationTarget>(update.cell, lattice);
    for (const auto& [id, T] : update.poses) graph.nodes[id] = T;
    if (update.unaligned) graph.unaligned.insert(update.id);
    for (const CellId id : update.aligned) graph.unaligned.erase(id);
    graph.constraints.insert(graph.constraints.end(), update.constraints.begin(),
                             update.constraints.end());
    updates.push_back(std::move(update));
  }
  TargetProvider provider() const {
    return [this](CellId id) { return targets.at(id); };
  }
  MapAccess access() const {
    return {provider(), [this](const PoseGraph& wanted) {
              auto index = std::make_shared<PlaceIndex>();
              for (const auto& [id, pose] : wanted.nodes) {
                index->add(id, targets.at(id)->cell(), *lattice);
              }
              return index;
            }};
  }
};

inline MapperOptions quick_mapper_options() {
  MapperOptions options;
  options.build.min_points = 4;
  options.registration_points = 8'000;
  options.loops.refine_points = 8'000;
  options.loops.search_points = 1'500;
  return options;
}

/// Of a session "drive" that nothing is known of.
inline FrontEnd quick_front_end() { return {quick_mapper_options(), "drive", BuiltMap().lattice}; }

}  // namespace cellmap::test
