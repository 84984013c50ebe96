#pragma once

#include <optional>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// A frame that stands upright on the ground below a sensor: z away from the ground plane, z = 0 in
/// it, the heading of x kept. How a sensor leans and how high it is mounted no longer matter there.
struct GroundFrame {
  Pose T_ground_sensor = Pose::Identity();
  bool found = false;  ///< else the sensor is taken to be upright, kUsualHeightM above the ground
};

/// What a LiDAR on a car is mounted at, about.
constexpr double kUsualHeightM = 1.7;

/// Fits the ground near a sensor (3 to 25 m away, leaning by up to 15 deg, 0.2 to 4 m below):
/// re-weighted least squares from nine attitudes, the one with most points within 0.15 m. Not found
/// where fewer than a quarter of the points that could be ground agree. `points` in a sensor or
/// CELL frame. About 0.5 ms and what it takes to read the points. Deterministic.
GroundFrame fit_ground(const PointCloud& points);

}  // namespace cellmap
