#include "cellmap/simulation/simulator.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "cellmap/core/error.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

SimulatorOptions short_drive(std::size_t scans) {
  SimulatorOptions options;
  options.scans = scans;
  options.lidar.columns = 360;  // enough, and quick
  return options;
}

PointCloud scan_at(const SimulatorOptions& options, std::size_t index) {
  const auto drive = simulate(options);
  drive->seek(index);
  return drive->next()->points;
}

bool same_bytes(const PointCloud& a, const PointCloud& b) {
  return a.x == b.x && a.y == b.y && a.z == b.z;
}

TEST(Simulator, GivesTheSameBytesForTheSameSeedAndOthersForAnother) {
  SimulatorOptions options = short_drive(40);
  const PointCloud once = scan_at(options, 30), again = scan_at(options, 30);
  options.seed = 2;
  const PointCloud other = scan_at(options, 30);

  EXPECT_TRUE(same_bytes(once, again));
  EXPECT_FALSE(same_bytes(once, other));
}

TEST(Simulator, GivesTheSameBytesForAnyThreadCount) {
  SimulatorOptions options = short_drive(40);
  const PointCloud serial = scan_at(options, 30);
  options.threads = 2;

  EXPECT_TRUE(same_bytes(serial, scan_at(options, 30)));
}

TEST(Simulator, GivesAScanTheSameBytesByNextAndBySeek) {
  const auto drive = simulate(short_drive(60));
  PointCloud by_next;
  for (int i = 0; i <= 45; i += 1) by_next = drive->next()->points;
  drive->seek(10);
  drive->next();
  drive->seek(45);

  EXPECT_TRUE(same_bytes(by_next, drive->next()->points));
}

TEST(Simulator, ReturnsAboutAsManyPointsAsARealHdl64) {
  const auto drive = simulate({});
  for (std::size_t i = 0; i < drive->size(); i += drive->size() / 8) {
    drive->seek(i);
    const auto scan = drive->next();
    EXPECT_GT(scan->points.size(), 100'000u) << "scan " << i;
    EXPECT_LT(scan->points.size(), 133'400u) << "scan " << i;
  }
}

TEST(Simulator, StopsAtTheLimitOfScans) {
  const auto drive = simulate(short_drive(3));
  std::size_t count = 0;
  while (const auto scan = drive->next()) EXPECT_EQ(scan->index, count++);

  EXPECT_EQ(count, 3u);
  EXPECT_EQ(drive->size(), 3u);
  EXPECT_THROW(drive->seek(4), Error);
}

TEST(Simulator, GivesTruthAsOdometryWhereAsked) {
  SimulatorOptions options = short_drive(50);
  options.odometry = "truth";
  const auto drive = simulate(options);
  for (std::size_t i : {0u, 20u, 49u}) {
    drive->seek(i);
    EXPECT_TRUE(drive->next()->T_odom_sensor.matrix() == drive->ground_truth()[i].pose.matrix());
  }
}

TEST(Simulator, MeasuresWithTheStatedNoiseAndLosesTheStatedShare) {
  SimulatorOptions options = short_drive(1);
  options.lidar.range_noise_m = 0;
  options.lidar.drop_out = 0;
  const PointCloud exact = scan_at(options, 0);
  options.lidar.range_noise_m = 0.02;
  const PointCloud noisy = scan_at(options, 0);
  options.lidar.drop_out = 0.05;
  const PointCloud thinned = scan_at(options, 0);

  ASSERT_EQ(noisy.size(), exact.size());
  double sum = 0, squares = 0, off_ray = 0;
  for (std::size_t i = 0; i < exact.size(); ++i) {
    const Eigen::Vector3f direction = exact[i].normalized(), error = noisy[i] - exact[i];
    const double along = direction.dot(error);
    sum += along;
    squares += along * along;
    off_ray =
        std::max(off_ray, static_cast<double>((error - direction * direction.dot(error)).norm()));
  }
  const auto n = static_cast<double>(exact.size());
  EXPECT_NEAR(sum / n, 0, 5 * 0.02 / std::sqrt(n));
  EXPECT_NEAR(std::sqrt(squares / n), 0.02, 5 * 0.02 / std::sqrt(2 * n));
  EXPECT_LT(off_ray, 1e-4);
  EXPECT_NEAR(static_cast<double>(thinned.size()) / n, 0.95, 5 * std::sqrt(0.05 * 0.95 / n));
}

TEST(Simulator, SeesTheGroundNoFartherThanItsReturnsCanBeFelt) {
  SimulatorOptions options = short_drive(1);
  options.lidar.range_noise_m = 0;
  options.lidar.drop_out = 0;
  const std::size_t felt = scan_at(options, 0).size();
  options.lidar.grazing_range_m = 0;

  EXPECT_GT(scan_at(options, 0).size(), felt);
}

TEST(Simulator, CarriesTheSensorAtItsMountingHeightInEveryLane) {
  SimulatorOptions options = short_drive(0);
  // One beam straight down measures the height above the ground itself.
  options.lidar.beams = 1;
  options.lidar.columns = 4;
  options.lidar.top_elevation_deg = options.lidar.bottom_elevation_deg = -90;
  options.lidar.range_noise_m = options.lidar.drop_out = 0;
  for (const double offset_m : {0.0, 3.5, -1.5}) {
    options.lateral_offset_m = offset_m;
    const auto drive = simulate(options);
    for (std::size_t i = 0; i < drive->size(); i += 110) {
      drive->seek(i);
      const auto scan = drive->next();
      ASSERT_EQ(scan->points.size(), 4u) << i;
      EXPECT_NEAR(-scan->points.z[0], 1.73, 0.04) << "scan " << i << ", offset " << offset_m;
    }
  }
}

TEST(Simulator, HasNothingWhereTheVehicleIs) {
  for (const double offset_m : {0.0, 4.0, -2.0}) {
    SimulatorOptions options = short_drive(0);
    options.lateral_offset_m = offset_m;
    options.lidar.bottom_elevation_deg = -80;
    const auto drive = simulate(options);
    for (std::size_t i = 0; i < drive->size(); i += 97) {
      drive->seek(i);
      const PointCloud points = drive->next()->points;
      std::size_t inside = 0;
      for (std::size_t k = 0; k < points.size(); ++k) {
        inside += std::abs(points.x[k]) < 2 && std::abs(points.y[k]) < 1 && points.z[k] > -1.4f;
      }
      EXPECT_EQ(inside, 0u) << "scan " << i << ", offset " << offset_m;
    }
  }
}

TEST(Simulator, DrivesTheSameTownInAnotherLane) {
  SimulatorOptions options = short_drive(200);
  const auto first = simulate(options);
  options.lateral_offset_m = 3;
  const auto second = simulate(options);
  for (std::size_t i = 0; i < 200; i += 20) {
    const Pose between = first->ground_truth()[i].pose.inverse() * second->ground_truth()[i].pose;
    EXPECT_NEAR(between.translation().x(), 0, 0.05);
    EXPECT_NEAR(between.translation().y(), 3, 0.05);
    EXPECT_LT(between.translation().z(), 0.15);
  }
}

TEST(Simulator, HasOtherNoiseOnAnotherDay) {
  SimulatorOptions options = short_drive(1);
  options.lidar.beams = 1;
  options.lidar.top_elevation_deg = options.lidar.bottom_elevation_deg = -60;  // the street alone
  options.lidar.drop_out = 0;
  const PointCloud today = scan_at(options, 0);
  options.traffic_seed = 77;
  const PointCloud other = scan_at(options, 0);

  ASSERT_EQ(today.size(), other.size());
  double squares = 0;
  for (std::size_t i = 0; i < today.size(); ++i) squares += (today[i] - other[i]).squaredNorm();
  // The difference of two independent draws has sqrt(2) times their deviation.
  const double n = static_cast<double>(today.size());
  EXPECT_NEAR(std::sqrt(squares / n), 0.02 * std::sqrt(2.0), 5 * 0.02 / std::sqrt(n));
}

TEST(Simulator, KnowsOtherSensorsByName) {
  for (const char* name : {"os1-64", "vlp16"}) {
    SimulatorOptions options = short_drive(1);
    options.lidar = LidarModel::by_name(name);
    const std::size_t rays = static_cast<std::size_t>(options.lidar.beams) *
                             static_cast<std::size_t>(options.lidar.columns);
    const PointCloud points = scan_at(options, 0);
    EXPECT_GT(points.size(), rays * 4 / 10) << name;
    EXPECT_LT(points.size(), rays) << name;
  }
  test::expect_error(
      ErrorCode::kInvalidArgument, [] { LidarModel::by_name("sonar"); }, "hdl64e", "os1-64",
      "vlp16", "sonar");
}

TEST(Simulator, SaysWhichOptionIsWrong) {
  const auto expect_refused = [](ErrorCode code, const std::string& part, const auto& change) {
    SimulatorOptions options;
    change(options);
    test::expect_error(
        code, [&] { simulate(options); }, part);
  };
  using Options = SimulatorOptions;
  expect_refused(ErrorCode::kNotFound, "nowhere.txt", [](Options& o) { o.route = "/nowhere.txt"; });
  expect_refused(ErrorCode::kNotFound, "nowhere.txt",
                 [](Options& o) { o.odometry = "/nowhere.txt"; });
  expect_refused(ErrorCode::kInvalidArgument, "lateral",
                 [](Options& o) { o.lateral_offset_m = 7; });
  expect_refused(ErrorCode::kInvalidArgument, "lateral",
                 [](Options& o) { o.lateral_offset_m = NAN; });
  expect_refused(ErrorCode::kInvalidArgument, "threads", [](Options& o) { o.threads = -1; });
  expect_refused(ErrorCode::kInvalidArgument, "beams", [](Options& o) { o.lidar.beams = 0; });
  expect_refused(ErrorCode::kInvalidArgument, "range",
                 [](Options& o) { o.lidar.max_range_m = 1e4; });
  expect_refused(ErrorCode::kInvalidArgument, "rate", [](Options& o) { o.lidar.rate_hz = NAN; });
}

}  // namespace
}  // namespace cellmap
