#pragma once

#include <gtest/gtest.h>

#include <vector>

#include "cellmap/scan/scan_source.hpp"
#include "support/scan_agreement.hpp"

namespace cellmap::test {

/// What must hold for a real drive that was opened with the right frame convention.
struct DriveExpectation {
  std::size_t scans = 0;
  std::size_t min_points = 0, max_points = 0;  ///< of every scan
  Eigen::Vector3d first_position = Eigen::Vector3d::Zero();
  std::size_t step = 1;        ///< scans i and i + step are compared
  double agreement_m = 0;      ///< median nearest-point distance that right poses stay below
  std::size_t max_pairs = 12;  ///< spread over the drive, plus the pair with the greatest turn
};

/// Whether two scans agree when moved by their poses, and do not without or against them.
inline void expect_agreement(const PosedScan& a, const PosedScan& b, double agreement_m) {
  const Pose T_a_b = a.T_odom_sensor.inverse() * b.T_odom_sensor;
  const double right = median_nearest_m(a.points, b.points, T_a_b);
  const std::string pair = "scans " + std::to_string(a.index) + " and " + std::to_string(b.index);
  EXPECT_LT(right, agreement_m) << pair;
  EXPECT_LT(right, 0.8 * median_nearest_m(a.points, b.points, Pose::Identity())) << pair;
  EXPECT_LT(right, 0.8 * median_nearest_m(a.points, b.points, T_a_b.inverse())) << pair;
}

/// Reads the whole drive once and holds it against `expected`.
inline void expect_drive(ScanSource& source, const DriveExpectation& expected) {
  ASSERT_EQ(source.size(), expected.scans);
  std::vector<Pose> poses;
  Stamp last = -1;
  while (const auto scan = source.next()) {
    EXPECT_EQ(scan->index, poses.size());
    EXPECT_GT(scan->stamp, last);
    EXPECT_GE(scan->points.size(), expected.min_points) << "scan " << scan->index;
    EXPECT_LE(scan->points.size(), expected.max_points) << "scan " << scan->index;
    poses.push_back(scan->T_odom_sensor);
    last = scan->stamp;
  }
  ASSERT_EQ(poses.size(), expected.scans);
  EXPECT_LT((poses[0].translation() - expected.first_position).norm(), 1e-6);

  const std::size_t pairs = expected.scans - expected.step;
  std::vector<std::size_t> firsts;
  for (std::size_t i = 0; i < pairs; i += 1 + pairs / expected.max_pairs) firsts.push_back(i);
  const auto turn = [&](std::size_t i) {
    return angle_between_rad(poses[i], poses[i + expected.step]);
  };
  std::size_t sharpest = 0;
  for (std::size_t i = 0; i < pairs; ++i) sharpest = turn(i) > turn(sharpest) ? i : sharpest;
  firsts.push_back(sharpest);
  for (const std::size_t i : firsts) {
    source.seek(i);
    const auto a = source.next();
    source.seek(i + expected.step);
    expect_agreement(*a, *source.next(), expected.agreement_m);
  }
}

}  // namespace cellmap::test
