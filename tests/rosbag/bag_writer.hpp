#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace cellmap::test {

/// A sensor_msgs/PointCloud2, field by field.
struct Cloud {
  struct Field {
    std::string name;
    std::uint32_t offset = 0;
    std::uint8_t type = 7;  ///< 7: float32, 8: float64
  };
  double stamp_s = 0;
  std::string frame = "velodyne";
  std::uint32_t height = 0, width = 0, point_step = 0, row_step = 0;
  std::vector<Field> fields;
  std::vector<std::uint8_t> data;
  bool is_big_endian = false;
};

/// Writes bags with Debian's rosbag library and Debian's messages. Those are C++17, so this is a
/// library of its own, which sees no header of the project.
class BagWriter {
 public:
  BagWriter(const std::string& file, const std::string& compression);
  ~BagWriter();

  void cloud(const std::string& topic, double received_s, const Cloud& cloud);
  /// nav_msgs/Odometry without rotation.
  void odometry(const std::string& topic, double stamp_s, const std::string& child, double x,
                double y, double z);
  /// geometry_msgs/PoseStamped without rotation.
  void pose(const std::string& topic, double stamp_s, double x, double y, double z);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap::test
