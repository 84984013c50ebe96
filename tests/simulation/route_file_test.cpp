#include <gtest/gtest.h>

#include <cmath>
#include <sstream>
#include <string>

#include "cellmap/evaluation/trajectory_metrics.hpp"
#include "cellmap/simulation/route.hpp"
#include "cellmap/simulation/simulator.hpp"
#include "support/expect_error.hpp"
#include "support/real_data.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

/// A left bend in the sensor frame (x forward, y left, z up), pose i at arc length i metres.
Trajectory bend(std::size_t count = 120) {
  std::vector<StampedPose> poses;
  constexpr double radius_m = 80;
  for (std::size_t i = 0; i < count; ++i) {
    const double angle = static_cast<double>(i) / radius_m;
    Pose T = Pose::Identity();
    T.linear() = Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    T.translation() << radius_m * std::sin(angle), radius_m * (1 - std::cos(angle)),
        0.02 * static_cast<double>(i);
    poses.push_back({static_cast<Stamp>(i) * 100'000'000, T});
  }
  return Trajectory(poses);
}

/// The same drive as KITTI writes it, axis by axis: camera x is to the right, y down, z forward.
std::string camera_rows(const Trajectory& trajectory) {
  std::ostringstream text;
  text.precision(17);
  const int axis[3] = {1, 2, 0};
  const double sign[3] = {-1, -1, 1};
  for (const StampedPose& sample : trajectory.poses()) {
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        text << sign[row] * sign[column] * sample.pose.linear()(axis[row], axis[column]) << ' ';
      }
      text << sign[row] * sample.pose.translation()[axis[row]] << (row == 2 ? '\n' : ' ');
    }
  }
  return text.str();
}

SimulatorOptions along(const std::filesystem::path& file) {
  SimulatorOptions options;
  options.route = file.string();
  options.odometry = "truth";
  options.lidar.columns = 360;
  return options;
}

TEST(RouteFile, IsFollowedWhetherItIsInTheCameraOrInTheSensorFrame) {
  const test::TempFolder folder;
  const Trajectory route = bend();
  const auto files = {folder.write("camera.txt", camera_rows(route)),
                      folder.write("sensor.txt", to_text(route, TrajectoryFormat::kKitti)),
                      folder.write("sensor.tum", to_text(route, TrajectoryFormat::kTum))};
  for (const auto& file : files) {
    const auto drive = simulate(along(file));
    ASSERT_EQ(drive->size(), route.size()) << file;
    for (std::size_t i = 0; i < route.size(); ++i) {
      const Pose T = drive->ground_truth()[i].pose;
      EXPECT_LT(angle_between_rad(T, route[i].pose), 1e-7) << file << " row " << i;
      EXPECT_LT((T.translation() - route[i].pose.translation()).head<2>().norm(), 1e-9);
      EXPECT_NEAR(T.translation().z(), route[i].pose.translation().z(), 0.05);
      EXPECT_EQ(drive->ground_truth()[i].stamp, route[i].stamp);
    }
    EXPECT_GT(drive->next()->points.size(), 15'000u);
  }
}

TEST(RouteFile, IsRefusedWhereItsFrameCannotBeTold) {
  const test::TempFolder folder;
  std::vector<StampedPose> poses;
  for (int i = 0; i < 20; ++i) {
    poses.push_back({i, Pose(Eigen::Translation3d(0, 0.5 * i, 0))});  // sideways
  }
  const auto sideways =
      folder.write("sideways.txt", to_text(Trajectory(poses), TrajectoryFormat::kKitti));
  const auto one = folder.write("one.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");

  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { simulate(along(sideways)); }, "frame", "sideways.txt");
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { simulate(along(one)); }, "two poses", "one.txt");
  SimulatorOptions stated = along(sideways);
  stated.route_frame = PoseFrame::kSensor;
  EXPECT_EQ(simulate(stated)->size(), 20u);
}

TEST(RouteFile, KeepsTheErrorOfARealEstimate) {
  const test::TempFolder folder;
  const Trajectory route = bend();
  std::vector<StampedPose> erring;
  for (std::size_t i = 0; i < route.size(); ++i) {
    Tangent error;
    error << 0.01, 0.002, -0.003, 0.0002, 0.0001, 0.0005;
    erring.push_back({route[i].stamp, route[i].pose * exp(static_cast<double>(i) * error)});
  }
  const Trajectory estimate(erring);
  SimulatorOptions options = along(folder.write("route.txt", camera_rows(route)));
  options.odometry = folder.write("estimate.txt", camera_rows(estimate)).string();
  options.lidar.beams = options.lidar.columns = 4;  // poses only
  const auto drive = simulate(options);
  const TrajectoryErrors expected = evaluate_trajectory(estimate, route);
  std::vector<StampedPose> odometry;
  while (const auto scan = drive->next()) odometry.push_back({scan->stamp, scan->T_odom_sensor});
  const TrajectoryErrors found = evaluate_trajectory(Trajectory(odometry), drive->ground_truth());

  EXPECT_GT(expected.t_rel_percent, 0.5);
  EXPECT_NEAR(found.t_rel_percent, expected.t_rel_percent, 0.01 * expected.t_rel_percent);
  EXPECT_NEAR(found.r_rel_deg_per_100m, expected.r_rel_deg_per_100m, 1e-5);
  EXPECT_NEAR(found.ape_rmse_m, expected.ape_rmse_m, 0.01 * expected.ape_rmse_m);
}

TEST(RouteFile, NeedsAnEstimateOfTheSameLength) {
  const test::TempFolder folder;
  SimulatorOptions options = along(folder.write("route.txt", camera_rows(bend(120))));
  options.odometry = folder.write("estimate.txt", camera_rows(bend(119))).string();
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { simulate(options); }, "120", "119");

  options.route = "town";
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { simulate(options); }, "town");
}

TEST(RouteFile, GivesARealEstimateTheErrorThatItIsKnownToHave) {
  const auto data = test::real_data("kitti-trajectories");
  if (!std::filesystem::exists(data)) GTEST_SKIP() << "no " << data;
  SimulatorOptions options = along(data / "ground_truth/07.txt");
  options.odometry = (data / "odometry/simple_online/07.txt").string();
  options.lidar.beams = options.lidar.columns = 4;  // poses only
  const auto drive = simulate(options);
  std::vector<StampedPose> odometry;
  while (const auto scan = drive->next()) odometry.push_back({scan->stamp, scan->T_odom_sensor});
  const TrajectoryErrors found = evaluate_trajectory(Trajectory(odometry), drive->ground_truth());

  // kitti-trajectories/EVAL.txt, an independent evaluation: 0.47 %, 0.44 deg / 100 m, 0.78 m.
  EXPECT_NEAR(found.t_rel_percent, 0.47, 0.03);
  EXPECT_NEAR(found.r_rel_deg_per_100m, 0.44, 0.02);
  EXPECT_NEAR(found.ape_rmse_m, 0.78, 0.04);
}

}  // namespace
}  // namespace cellmap
