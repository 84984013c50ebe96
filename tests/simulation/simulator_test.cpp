#include "cellmap/simulation/simulator.hpp"

#include <gtest/gtest.h>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

SimulatorOptions short_drive(std::size_t scans) {
  SimulatorOptions options;
  options.scans = scans;
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
  const auto drive = simulate(short_drive(0));
  for (std::size_t i = 0; i < drive->size(); i += drive->size() / 12) {
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

}  // namespace
}  // namespace cellmap
