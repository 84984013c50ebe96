#pragma once

#include <cstddef>
#include <span>
#include <string>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/scan/trajectory.hpp"

namespace cellmap::ros_bag {

/// A scan as ROS sends it.
struct CloudMessage {
  Stamp stamp = 0;
  std::string frame;  ///< the sensor's
  PointCloud points;  ///< as they are, NaN included
};

/// Time and frame of any message that begins with a std_msgs/Header. Throws Error{kCorruptData}.
CloudMessage read_header(std::span<const std::byte> message);

/// A sensor_msgs/PointCloud2 with fields x, y, z of float32 or float64. Throws
/// Error{kCorruptData}, {kUnsupported}, {kTooLarge} over `kMaxScanPoints`.
CloudMessage read_point_cloud2(std::span<const std::byte> message);

/// Where something is, as ROS says it.
struct PoseMessage {
  StampedPose pose;
  std::string child_frame;  ///< of what; empty where the message does not say
};

/// A nav_msgs/Odometry or, where `is_odometry` is false, a geometry_msgs/PoseStamped. Throws
/// Error{kCorruptData}.
PoseMessage read_pose(std::span<const std::byte> message, bool is_odometry);

}  // namespace cellmap::ros_bag
