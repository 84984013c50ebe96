#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <filesystem>
#include <vector>

#include "cellmap/scan/scan_source.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap::simulation {

/// The poses of a drive, one a scan: T_world_sensor, x forward and z up, first pose at the origin
/// of its own making.
using Route = std::vector<StampedPose>;

/// About 1 km through a town of two blocks: a loop around the first, its first street and two more
/// driven again in the same direction, and a street that crosses the first one. Up to 11 m/s,
/// slower in corners; gentle hills. Starts at the identity.
Route town_route(double rate_hz);

/// About 3.72 km through a larger town of unequal blocks, as long as KITTI's sequence 00: a fifth
/// of it is driven twice, in either direction, and streets cross. Else as `town_route`.
Route city_route(double rate_hz);

/// The same drive with one pose each `spacing_m` of the way, interpolated; at least two.
Route spaced(const Route& route, double spacing_m);

/// The poses of a trajectory file, turned to x forward and z up where they are in the camera frame
/// (z forward, x right, y down). Only axes change: the lever arm between camera and LiDAR, which
/// no pose file gives, is ignored. With PoseFrame::kAuto the frame is told by the axis that the
/// vehicle moves along. Throws what `read_trajectory` throws; Error{kInvalidArgument} where the
/// frame cannot be told or there are fewer than two poses.
Route route_from_file(const std::filesystem::path& file, PoseFrame frame);

/// The line that a route draws on the ground plan, by arc length: where streets are.
class Centreline {
 public:
  explicit Centreline(const Route& route);

  struct Point {
    Eigen::Vector2d position;
    double heading_rad;
    Eigen::Vector2d left() const;
  };

  /// Points at least 1 m apart, with the height of the sensor there.
  const std::vector<Eigen::Vector3d>& vertices() const { return vertices_; }
  double length_m() const { return arc_m_.back(); }
  /// Point at arc length `s_m`, clamped to the line.
  Point at(double s_m) const;
  /// Arc length at which the pose `index` of the route lies.
  double arc_of_pose_m(std::size_t index) const { return arc_of_pose_m_[index]; }
  double arc_of_vertex_m(std::size_t index) const { return arc_m_[index]; }

 private:
  std::vector<Eigen::Vector3d> vertices_;
  std::vector<double> arc_m_;
  std::vector<double> arc_of_pose_m_;
};

}  // namespace cellmap::simulation
