#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "cellmap/scan/scan_source.hpp"

namespace cellmap::ros_bag {

struct BagOptions {
  /// Of the scans, sensor_msgs/PointCloud2; empty: the only one there is.
  std::string points_topic = {};
  /// Of the odometry, nav_msgs/Odometry or geometry_msgs/PoseStamped; empty: the only one.
  std::string odometry_topic = {};
  /// A TUM trajectory T_odom_sensor in place of the bag's odometry; empty: the bag's.
  std::filesystem::path poses = {};
};

/// Opens a ROS 1 bag as a drive: its scans by their time, with odometry interpolated at it. Scans
/// before the first pose and after the last are left out, of several at one time all but the first.
/// Odometry must be that of the sensor: where its child frame is another than the scans', it is
/// refused. One pass over the bag, some 50 bytes a scan and 80 a pose; points are read when they
/// are asked for. Throws Error{kNotFound}, {kInvalidArgument} where a topic must be named,
/// {kUnsupported}, {kCorruptData}, {kTooLarge} over 16,777,216 messages, always with the file's
/// name.
std::unique_ptr<ScanSource> open_bag(const std::filesystem::path& file,
                                     const BagOptions& options = {});

}  // namespace cellmap::ros_bag
