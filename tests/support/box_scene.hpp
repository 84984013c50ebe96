#pragma once

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/pose.hpp"

namespace cellmap::test {

/// A world of axis-aligned boxes, seen from inside or outside, whose ray casts are exact: the
/// simplest scene in which the truth is known. World frame, metres.
class BoxScene {
 public:
  struct Box {
    Eigen::Vector3d min, max;
  };

  void add(const Eigen::Vector3d& min, const Eigen::Vector3d& max) { boxes_.push_back({min, max}); }

  /// Distance along a unit direction to the first surface, or infinity.
  double cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Box& box : boxes_) {
      double enter = -std::numeric_limits<double>::infinity(), leave = -enter;
      for (int axis = 0; axis < 3; ++axis) {
        const double a = (box.min[axis] - origin[axis]) / direction[axis];
        const double b = (box.max[axis] - origin[axis]) / direction[axis];
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
      }
      if (enter > leave || leave <= 0) continue;
      nearest = std::min(nearest, enter > 0 ? enter : leave);
    }
    return nearest;
  }

  /// What a spinning LiDAR at `T_world_sensor` sees, in its own frame: `beams` evenly spaced from
  /// `lowest_deg` to `highest_deg`, with range noise, up to `max_range_m`.
  struct Sensor {
    int beams = 64;
    int azimuths = 900;
    double lowest_deg = -24.9, highest_deg = 2.0;
    double max_range_m = 120;
    double noise_m = 0;
    unsigned seed = 1;
  };
  PointCloud scan(const Pose& T_world_sensor, const Sensor& sensor) const {
    std::mt19937 rng(sensor.seed);
    std::normal_distribution<double> noise(0, 1);
    PointCloud points;
    for (int b = 0; b < sensor.beams; ++b) {
      const double share = sensor.beams == 1 ? 0 : static_cast<double>(b) / (sensor.beams - 1);
      const double elevation =
          radians(sensor.lowest_deg + share * (sensor.highest_deg - sensor.lowest_deg));
      for (int a = 0; a < sensor.azimuths; ++a) {
        // Half a step off the axes, and each beam a little more, as real sensors are.
        const double azimuth = 2 * std::numbers::pi * (a + 0.5 + 0.37 * b) / sensor.azimuths;
        const Eigen::Vector3d d(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
        const double range = cast(T_world_sensor.translation(), T_world_sensor.linear() * d);
        if (!(range < sensor.max_range_m)) continue;
        const double measured = range + (sensor.noise_m > 0 ? sensor.noise_m * noise(rng) : 0.0);
        points.push_back((measured * d).cast<float>());
      }
    }
    return points;
  }
  PointCloud scan(const Pose& T_world_sensor) const { return scan(T_world_sensor, Sensor{}); }

  static double radians(double deg) { return deg * std::numbers::pi / 180; }

 private:
  std::vector<Box> boxes_;
};

/// A level pose at (x, y, 0) with a heading.
inline Pose level_pose(double x, double y, double yaw_deg) {
  Pose T = Pose::Identity();
  T.translation() << x, y, 0;
  T.linear() =
      Eigen::AngleAxisd(BoxScene::radians(yaw_deg), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return T;
}

/// A street along x with ground at z = -1.7, buildings of different depths on both sides with gaps,
/// and things that stand in front of them: enough structure to hold every motion.
inline BoxScene street() {
  BoxScene scene;
  scene.add({-300, -300, -2.7}, {300, 300, -1.7});
  for (int k = -10; k < 10; ++k) {
    const double x = 14.0 * k;
    scene.add({x, 7.0 + (k * 7 % 5) * 0.6, -1.7}, {x + 10 + (k % 3), 20, 8});
    scene.add({x + 4, -21, -1.7}, {x + 15 + (k % 2), -8.0 - (k * 3 % 4) * 0.7, 10});
    scene.add({x + 2, 5.0, -1.7}, {x + 2.3, 5.3, 4});
    scene.add({x + 9, -5.5, -1.7}, {x + 13, -3.7, -0.2});
  }
  return scene;
}

/// Two parallel walls without ends, and a floor: nothing holds the motion along x.
inline BoxScene corridor() {
  BoxScene scene;
  scene.add({-1000, -1000, -2.7}, {1000, 1000, -1.7});
  scene.add({-1000, 3.0, -1.7}, {1000, 4.0, 30});
  scene.add({-1000, -5.0, -1.7}, {1000, -4.0, 30});
  return scene;
}

}  // namespace cellmap::test
