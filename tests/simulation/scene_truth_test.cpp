#include "cellmap/simulation/scene_truth.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// A LiDAR without noise, thin enough for a test, and the truth of the same day.
SimulatorOptions a_day(std::uint64_t traffic_seed) {
  SimulatorOptions options;
  options.scans = 4;
  options.spacing_m = 6;
  options.odometry = "truth";
  options.traffic_seed = traffic_seed;
  options.lidar.beams = 24;
  options.lidar.columns = 240;
  options.lidar.range_noise_m = 0;
  options.lidar.drop_out = 0;
  return options;
}

struct Seen {
  std::vector<Eigen::Vector3d> points, behind;  ///< world frame; a metre behind each point
};

Seen seen_in(const SimulatorOptions& options, std::size_t scan) {
  const auto source = simulate(options);
  source->seek(scan);
  const PosedScan posed = *source->next();
  Seen seen;
  for (std::size_t i = 0; i < posed.points.size(); ++i) {
    const Eigen::Vector3d p = posed.points[i].cast<double>();
    seen.points.push_back(source->ground_truth()[scan].pose * p);
    seen.behind.push_back(source->ground_truth()[scan].pose * Eigen::Vector3d(p + p.normalized()));
  }
  return seen;
}

TEST(SceneTruth, EveryPointOfAScanLiesOnSomething) {
  const SimulatorOptions options = a_day(5);
  const SceneTruth truth(options);
  const Seen seen = seen_in(options, 2);
  ASSERT_GT(seen.points.size(), 1000u);
  const std::vector<double> to_vehicle_m = truth.to_vehicles_m(seen.points, 2, 1);
  std::size_t on_vehicles = 0;
  for (std::size_t i = 0; i < seen.points.size(); ++i) {
    // The ground is cast as triangles of 2 m, and told by its height.
    EXPECT_LT(std::min(to_vehicle_m[i], truth.to_standing_m(seen.points[i])), 0.1);
    on_vehicles += to_vehicle_m[i] < 0.01;
  }
  EXPECT_GT(on_vehicles, 50u);
}

TEST(SceneTruth, WhatAScanSawIsInSightAndWhatStandsBehindItIsNot) {
  const SimulatorOptions options = a_day(5);
  const SceneTruth truth(options);
  const Seen seen = seen_in(options, 2);
  const std::vector<bool> in_sight = truth.in_sight(truth.T_world_sensor(2), seen.points);
  const std::vector<bool> behind = truth.in_sight(truth.T_world_sensor(2), seen.behind);
  std::size_t standing = 0, wrong = 0;
  for (std::size_t i = 0; i < seen.points.size(); ++i) {
    if (truth.to_standing_m(seen.points[i]) > 0.02) continue;  // or on a vehicle that moves
    ++standing;
    wrong += !in_sight[i] || behind[i];
  }
  ASSERT_GT(standing, 1000u);
  EXPECT_LE(wrong, standing / 100);  // at the border of the field of view, in float
}

TEST(SceneTruth, AnotherDayHasTheSameTownAndOtherCars) {
  const SimulatorOptions options = a_day(5);
  const SceneTruth today(options), tomorrow(a_day(6));
  const Seen seen = seen_in(options, 2);
  const std::vector<double> to_vehicle_m = today.to_vehicles_m(seen.points, 2, 1);
  std::size_t gone = 0;
  for (std::size_t i = 0; i < seen.points.size(); ++i) {
    const double then_m = tomorrow.to_standing_m(seen.points[i]);
    if (to_vehicle_m[i] > 0.3) {
      EXPECT_LT(then_m, 0.1);
    } else {
      gone += then_m > 0.3;
    }
  }
  EXPECT_GT(gone, 30u);
}

TEST(SceneTruth, RefusesWhatTheSimulatorRefuses) {
  SimulatorOptions options = a_day(1);
  options.route = "no such file";
  EXPECT_THROW(SceneTruth{options}, Error);
}

}  // namespace
}  // namespace cellmap
