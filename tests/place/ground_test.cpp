#include "cellmap/place/ground.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "cellmap/place/polar_image.hpp"
#include "support/town_drive.hpp"

namespace cellmap {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

Pose leaning(double lean_deg, double towards_deg) {
  const double towards = towards_deg * kDeg;
  Pose T = Pose::Identity();
  T.rotate(
      Eigen::AngleAxisd(lean_deg * kDeg, Eigen::Vector3d(std::cos(towards), std::sin(towards), 0)));
  return T;
}

/// A flat street with walls on either side, seen from 1.5 m above it.
PointCloud street(double height_m) {
  std::mt19937 rng(5);
  std::uniform_real_distribution<float> along(-30, 30), across(-8, 8), up(0, 6);
  std::normal_distribution<float> noise(0, 0.02f);
  PointCloud points;
  const auto z0 = static_cast<float>(-height_m);
  for (int i = 0; i < 4000; ++i) points.push_back({along(rng), across(rng), z0 + noise(rng)});
  for (int i = 0; i < 4000; ++i) points.push_back({along(rng), i % 2 ? 8.0f : -8.0f, z0 + up(rng)});
  return points;
}

double angle_to_vertical_deg(const Pose& T_ground_sensor, const Pose& T_true_sensor) {
  const Eigen::Vector3d found = T_ground_sensor.linear().row(2);
  const Eigen::Vector3d up = T_true_sensor.linear().row(2);
  return std::acos(std::min(1.0, found.dot(up))) / kDeg;
}

TEST(Ground, IsFoundHoweverTheSensorLeansUpTo10Degrees) {
  const PointCloud points = street(1.5);
  for (const double lean_deg : {0.0, 3.0, 10.0}) {
    for (int towards_deg = 0; towards_deg < 360; towards_deg += 40) {
      const Pose T_upright_sensor = leaning(lean_deg, towards_deg);
      const GroundFrame frame = fit_ground(transformed(points, T_upright_sensor.inverse()));
      ASSERT_TRUE(frame.found);
      EXPECT_LT(angle_to_vertical_deg(frame.T_ground_sensor, T_upright_sensor), 0.5);
      EXPECT_NEAR(frame.T_ground_sensor.translation().z(), 1.5, 0.06);
      EXPECT_LT(std::abs(yaw_of(frame.T_ground_sensor)), 2 * kDeg);
    }
  }
}

TEST(Ground, IsNotFoundWhereThereIsNone) {
  PointCloud wall;
  for (int i = 0; i < 4000; ++i) {
    wall.push_back({10.0f, 0.01f * static_cast<float>(i % 2000 - 1000),
                    0.5f + 0.002f * static_cast<float>(i)});
  }
  const GroundFrame frame = fit_ground(wall);
  EXPECT_FALSE(frame.found);
  EXPECT_EQ(frame.T_ground_sensor.linear(), Eigen::Matrix3d::Identity());
}

TEST(Ground, OfASimulatedScanIsTheStreetBelowTheVehicle) {
  const auto source = test::TownDrive{.laps = 0.3}.open();
  while (const auto scan = source->next()) {
    const GroundFrame frame = fit_ground(scan->points);
    ASSERT_TRUE(frame.found) << scan->index;
    EXPECT_NEAR(frame.T_ground_sensor.translation().z(), 1.73, 0.25) << scan->index;
    EXPECT_LT(angle_to_vertical_deg(frame.T_ground_sensor, Pose::Identity()), 3.0);
  }
}

}  // namespace
}  // namespace cellmap
