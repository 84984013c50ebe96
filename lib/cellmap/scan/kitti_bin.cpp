#include <bit>
#include <cstring>
#include <limits>

#include "cellmap/core/error.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "cellmap/scan/text_table.hpp"

namespace cellmap {
namespace {

static_assert(std::endian::native == std::endian::little && std::numeric_limits<float>::is_iec559,
              "KITTI's .bin files are little-endian float32 and are read as they are");

constexpr std::size_t kBytesPerPoint = 4 * sizeof(float);

}  // namespace

PointCloud parse_kitti_bin(std::span<const std::byte> bytes, std::size_t max_points) {
  const std::size_t count = bytes.size() / kBytesPerPoint;
  if (bytes.size() % kBytesPerPoint != 0) {
    throw Error(ErrorCode::kCorruptData,
                "expected a multiple of 16 bytes (float32 x, y, z, intensity a point), found " +
                    std::to_string(bytes.size()) + ": the scan is cut off or not in KITTI's .bin" +
                    " layout");
  }
  if (count > max_points) {
    throw Error(ErrorCode::kTooLarge, "expected a scan of at most " + std::to_string(max_points) +
                                          " points, found " + std::to_string(count));
  }
  PointCloud points;
  points.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    float xyz[3];
    std::memcpy(xyz, bytes.data() + i * kBytesPerPoint, sizeof(xyz));
    points.push_back({xyz[0], xyz[1], xyz[2]});
  }
  return points;
}

PointCloud read_kitti_bin(const std::filesystem::path& file) {
  const std::string bytes = read_file(file, kMaxScanPoints * kBytesPerPoint);
  if (bytes.empty()) {
    throw Error(ErrorCode::kCorruptData,
                file.string() + ": expected a scan, found an empty file (an interrupted copy?)");
  }
  try {
    return parse_kitti_bin(std::as_bytes(std::span(bytes)), kMaxScanPoints);
  } catch (const Error& error) {
    throw Error(error.code(), file.string() + ": " + error.what());
  }
}

void write_kitti_bin(const std::filesystem::path& file, const PointCloud& points) {
  if (points.empty() || points.size() > kMaxScanPoints) {
    throw Error(ErrorCode::kInvalidArgument, file.string() + ": a scan file holds 1 to " +
                                                 std::to_string(kMaxScanPoints) + " points, not " +
                                                 std::to_string(points.size()));
  }
  std::string bytes(points.size() * kBytesPerPoint, '\0');
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float row[4] = {points.x[i], points.y[i], points.z[i], 0.0F};
    std::memcpy(bytes.data() + i * kBytesPerPoint, row, sizeof(row));
  }
  write_file(file, bytes);
}

}  // namespace cellmap
