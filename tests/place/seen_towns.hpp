#pragma once

#include <random>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/place/polar_image.hpp"

namespace cellmap::test {

/// Upright things at random places on flat ground; z above the ground.
inline PointCloud town(unsigned seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<float> xy(-70, 70), height(1, 9), extent(-3, 3);
  PointCloud points;
  for (int thing = 0; thing < 60; ++thing) {
    const float x = xy(rng), y = xy(rng), top = height(rng);
    for (int i = 0; i < 60; ++i) {
      points.push_back({x + extent(rng), y + extent(rng), top * static_cast<float>(i % 10) / 10});
    }
  }
  for (int i = 0; i < 4000; ++i) points.push_back({xy(rng), xy(rng), 0});
  return points;
}

inline PointCloud turned_cloud(const PointCloud& points, double yaw_rad) {
  return transformed(points, upright_pose(0, 0, yaw_rad));
}

/// As a sensor 1.7 m above the ground would see it.
inline PointCloud seen(const PointCloud& points, const Pose& T_ground_sensor) {
  return transformed(points, T_ground_sensor.inverse());
}

inline Pose sensor_at(double x, double y, double yaw_rad) {
  Pose T = upright_pose(x, y, yaw_rad);
  T.translation().z() = 1.7;
  return T;
}

}  // namespace cellmap::test
