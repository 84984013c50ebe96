#include "cellmap/codec/scan_codec.hpp"

#include <string>

#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/scan_generated.h"

namespace cellmap {
namespace {

constexpr std::size_t kMaxScanTables = 64;
constexpr BufferKind kScanKind = {
    "scan", "CSCN", kMaxScanPoints * 3 * sizeof(float) + 4096,
    [](flatbuffers::Verifier& v) { return schema::VerifyScanBuffer(v); }};

void check_point_count(std::size_t x, std::size_t y, std::size_t z) {
  if (x != y || x != z) {
    throw Error(ErrorCode::kCorruptData, "a scan has as many x as y and z, but found " +
                                             std::to_string(x) + ", " + std::to_string(y) +
                                             " and " + std::to_string(z));
  }
  if (x > kMaxScanPoints) {
    throw Error(ErrorCode::kTooLarge, "a scan has at most " + std::to_string(kMaxScanPoints) +
                                          " points, but found " + std::to_string(x));
  }
}

std::vector<float> floats_from_wire(const flatbuffers::Vector<float>& wire) {
  return std::vector<float>(wire.data(), wire.data() + wire.size());
}

}  // namespace

Bytes encode_scan(const PosedScan& scan) {
  const PointCloud& points = scan.points;
  check_point_count(points.x.size(), points.y.size(), points.z.size());
  if (!is_rigid(scan.T_odom_sensor)) {
    throw Error(ErrorCode::kInvalidArgument,
                "the scan's pose T_odom_sensor is not a rigid transform of finite numbers");
  }
  flatbuffers::FlatBufferBuilder builder(1024 + 3 * sizeof(float) * points.size());
  const auto x = builder.CreateVector(points.x);
  const auto y = builder.CreateVector(points.y);
  const auto z = builder.CreateVector(points.z);
  const schema::Pose T_odom_sensor = pose_to_wire(scan.T_odom_sensor);
  schema::FinishScanBuffer(builder, schema::CreateScan(builder, kFormatVersion, scan.index,
                                                       scan.stamp, &T_odom_sensor, x, y, z));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  return Bytes(begin, begin + builder.GetSize());
}

PosedScan decode_scan(std::span<const std::byte> bytes) {
  const Bytes copy = verified_copy(bytes, kScanKind, kMaxScanTables);
  const schema::Scan& wire = *schema::GetScan(copy.data());
  check_point_count(wire.x()->size(), wire.y()->size(), wire.z()->size());
  PosedScan scan;
  scan.index = wire.index();
  scan.stamp = wire.stamp_ns();
  scan.T_odom_sensor = pose_from_wire(wire.t_odom_sensor(), "the scan's pose T_odom_sensor");
  scan.points.x = floats_from_wire(*wire.x());
  scan.points.y = floats_from_wire(*wire.y());
  scan.points.z = floats_from_wire(*wire.z());
  return scan;
}

}  // namespace cellmap
