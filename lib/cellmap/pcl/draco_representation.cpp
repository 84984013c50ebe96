#include <draco/compression/decode.h>
#include <draco/compression/encode.h>
#include <draco/point_cloud/point_cloud_builder.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "cellmap/core/error.hpp"
#include "cellmap/pcl/pcl_representations.hpp"

namespace cellmap::pcl_io {
namespace {

/// Draco cuts the longest side of the bounding box into 2^bits steps.
int bits_for(const PointCloud& points, double step_m) {
  double longest_m = 0;
  for (const std::vector<float>* axis : {&points.x, &points.y, &points.z}) {
    const auto [low, high] = std::minmax_element(axis->begin(), axis->end());
    longest_m = std::max<double>(longest_m, *high - *low);
  }
  return std::clamp(static_cast<int>(std::ceil(std::log2(longest_m / step_m))), 1, 30);
}

Bytes encode(const PointCloud& points, double step_m) {
  draco::PointCloudBuilder builder;
  builder.Start(static_cast<draco::PointIndex::ValueType>(points.size()));
  const int position =
      builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    const float xyz[] = {points.x[i], points.y[i], points.z[i]};
    builder.SetAttributeValueForPoint(position, draco::PointIndex(i), xyz);
  }
  const auto cloud = builder.Finalize(false);
  draco::Encoder encoder;
  encoder.SetSpeedOptions(0, 0);
  encoder.SetEncodingMethod(draco::POINT_CLOUD_KD_TREE_ENCODING);
  encoder.SetAttributeQuantization(draco::GeometryAttribute::POSITION, bits_for(points, step_m));
  draco::EncoderBuffer buffer;
  const draco::Status status = encoder.EncodePointCloudToBuffer(*cloud, &buffer);
  if (!status.ok()) throw Error(ErrorCode::kInternal, "Draco: " + status.error_msg_string());
  Bytes bytes(buffer.size());
  std::memcpy(bytes.data(), buffer.data(), bytes.size());
  return bytes;
}

PointCloud decode(const Bytes& bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  draco::Decoder decoder;
  auto decoded = decoder.DecodePointCloudFromBuffer(&buffer);
  if (!decoded.ok()) {
    throw Error(ErrorCode::kCorruptData, "Draco: " + decoded.status().error_msg_string());
  }
  const auto cloud = std::move(decoded).value();
  const auto* position = cloud->GetNamedAttribute(draco::GeometryAttribute::POSITION);
  if (position == nullptr) throw Error(ErrorCode::kCorruptData, "Draco: expected positions");
  PointCloud points;
  points.reserve(cloud->num_points());
  for (draco::PointIndex i(0); i < cloud->num_points(); ++i) {
    float xyz[3] = {};
    position->GetMappedValue(i, xyz);
    points.push_back({xyz[0], xyz[1], xyz[2]});
  }
  return points;
}

}  // namespace

Representation draco_compressed(double voxel_m, double step_m) {
  char name[64];
  std::snprintf(name, sizeof(name), "%g m voxels, Draco, %g m", voxel_m, step_m);
  return {name,
          [=](const ComparedDrive& drive) {
            return MapFiles{
                {"points.drc", encode(voxel_means(stacked_points(drive), voxel_m), step_m)}};
          },
          [](const MapFiles& files) {
            DecodedMap map;
            map.points = decode(files.at(0).bytes);
            return map;
          }};
}

}  // namespace cellmap::pcl_io
