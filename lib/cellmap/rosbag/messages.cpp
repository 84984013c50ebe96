#include "cellmap/rosbag/messages.hpp"

#include <array>
#include <cmath>
#include <optional>

#include "cellmap/core/error.hpp"
#include "cellmap/rosbag/byte_reader.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap::ros_bag {
namespace {

constexpr std::uint8_t kFloat32 = 7, kFloat64 = 8;
constexpr std::uint32_t kMaxFields = 256;

Error corrupt_message(const std::string& message) { return {ErrorCode::kCorruptData, message}; }

/// std_msgs/Header.
CloudMessage header_of(ByteReader& reader) {
  CloudMessage header;
  reader.number<std::uint32_t>();  // seq
  const auto seconds = reader.number<std::uint32_t>();
  const auto nanoseconds = reader.number<std::uint32_t>();
  if (nanoseconds >= 1'000'000'000) throw corrupt_message("a message's time is none");
  header.stamp = Stamp{seconds} * 1'000'000'000 + nanoseconds;
  header.frame = reader.text();
  return header;
}

struct Coordinate {
  std::uint32_t offset = 0;
  bool is_double = false;
};

/// Where x, y and z lie in a point of so many bytes.
std::array<Coordinate, 3> coordinates_of(ByteReader& reader) {
  std::array<std::optional<Coordinate>, 3> found;
  const auto count = reader.number<std::uint32_t>();
  if (count > kMaxFields) throw corrupt_message("a point has more than 256 fields");
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::string name = reader.text();
    const auto offset = reader.number<std::uint32_t>();
    const auto type = reader.number<std::uint8_t>();
    reader.number<std::uint32_t>();  // count
    if (name.size() != 1 || name[0] < 'x' || name[0] > 'z') continue;
    if (type != kFloat32 && type != kFloat64) {
      throw Error(ErrorCode::kUnsupported, "expected x, y, z of float32 or float64");
    }
    found[name[0] - 'x'] = Coordinate{offset, type == kFloat64};
  }
  if (!found[0] || !found[1] || !found[2]) throw corrupt_message("a scan's points lack x, y or z");
  return {*found[0], *found[1], *found[2]};
}

double read_coordinate(std::span<const std::byte> point, const Coordinate& coordinate) {
  ByteReader reader(point.subspan(coordinate.offset));
  return coordinate.is_double ? reader.number<double>() : reader.number<float>();
}

}  // namespace

CloudMessage read_header(std::span<const std::byte> message) {
  ByteReader reader(message);
  return header_of(reader);
}

CloudMessage read_point_cloud2(std::span<const std::byte> message) {
  ByteReader reader(message);
  CloudMessage cloud = header_of(reader);
  const std::uint64_t height = reader.number<std::uint32_t>();
  const std::uint64_t width = reader.number<std::uint32_t>();
  const auto coordinates = coordinates_of(reader);
  const bool is_big_endian = reader.number<std::uint8_t>() != 0;
  const std::uint64_t point_step = reader.number<std::uint32_t>();
  const std::uint64_t row_step = reader.number<std::uint32_t>();
  const auto data = reader.take(reader.number<std::uint32_t>());
  if (is_big_endian) throw Error(ErrorCode::kUnsupported, "expected little-endian points");
  if (width > 0 && height > kMaxScanPoints / width) {
    throw Error(ErrorCode::kTooLarge,
                "expected a scan of at most " + std::to_string(kMaxScanPoints) + " points, found " +
                    std::to_string(height) + " rows of " + std::to_string(width));
  }
  for (const Coordinate& coordinate : coordinates) {
    if (coordinate.offset + (coordinate.is_double ? 8u : 4u) > point_step) {
      throw corrupt_message("a coordinate lies outside of its point");
    }
  }
  if (width * point_step > row_step || height * row_step > data.size()) {
    throw corrupt_message("a scan's points are more than its bytes");
  }
  cloud.points.reserve(width * height);
  for (std::uint64_t row = 0; row < height; ++row) {
    for (std::uint64_t i = 0; i < width; ++i) {
      const auto point = data.subspan(row * row_step + i * point_step, point_step);
      cloud.points.push_back({static_cast<float>(read_coordinate(point, coordinates[0])),
                              static_cast<float>(read_coordinate(point, coordinates[1])),
                              static_cast<float>(read_coordinate(point, coordinates[2]))});
    }
  }
  return cloud;
}

PoseMessage read_pose(std::span<const std::byte> message, bool is_odometry) {
  ByteReader reader(message);
  const CloudMessage header = header_of(reader);
  PoseMessage found;
  found.pose.stamp = header.stamp;
  if (is_odometry) found.child_frame = reader.text();
  std::array<double, 7> values;
  for (double& value : values) {
    value = reader.number<double>();
    if (!std::isfinite(value)) throw corrupt_message("a pose is not of finite numbers");
  }
  const Eigen::Quaterniond q(values[6], values[3], values[4], values[5]);
  if (std::abs(q.norm() - 1) > 1e-3) throw corrupt_message("a pose's quaternion is none");
  found.pose.pose.linear() = q.normalized().toRotationMatrix();
  found.pose.pose.translation() << values[0], values[1], values[2];
  return found;
}

}  // namespace cellmap::ros_bag
