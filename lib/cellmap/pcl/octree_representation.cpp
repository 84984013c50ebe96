#include <pcl/compression/octree_pointcloud_compression.h>
#include <pcl/point_types.h>

#include <cstring>
#include <sstream>

#include "cellmap/core/error.hpp"
#include "cellmap/pcl/pcl_representations.hpp"

namespace cellmap::pcl_io {
namespace {

using Compression = pcl::io::OctreePointCloudCompression<pcl::PointXYZ>;

/// All points are kept: each as its voxel and the steps from the voxel's corner.
Compression compression(double voxel_m, double step_m) {
  return Compression(pcl::io::MANUAL_CONFIGURATION, /*showStatistics=*/false, step_m, voxel_m,
                     /*doVoxelGridDownDownSampling=*/false, /*iFrameRate=*/1,
                     /*doColorEncoding=*/false);
}

Bytes encode(const PointCloud& points, double voxel_m, double step_m) {
  const pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  for (std::size_t i = 0; i < points.size(); ++i) {
    cloud->push_back({points.x[i], points.y[i], points.z[i]});
  }
  std::stringstream stream;
  compression(voxel_m, step_m).encodePointCloud(cloud, stream);
  const std::string text = stream.str();
  Bytes bytes(text.size());
  std::memcpy(bytes.data(), text.data(), text.size());
  return bytes;
}

PointCloud decode(const Bytes& bytes, double voxel_m, double step_m) {
  std::stringstream stream(std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
  pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  compression(voxel_m, step_m).decodePointCloud(stream, cloud);
  PointCloud points;
  points.reserve(cloud->size());
  for (const pcl::PointXYZ& p : *cloud) points.push_back({p.x, p.y, p.z});
  return points;
}

}  // namespace

Representation octree_compressed(double voxel_m, double step_m) {
  char name[64];
  std::snprintf(name, sizeof(name), "%g m voxels, PCL octree, %g m", voxel_m, step_m);
  return {name,
          [=](const ComparedDrive& drive) {
            const PointCloud means = voxel_means(stacked_points(drive), voxel_m);
            return MapFiles{{"points.octree", encode(means, voxel_m, step_m)}};
          },
          [=](const MapFiles& files) {
            DecodedMap map;
            map.points = decode(files.at(0).bytes, voxel_m, step_m);
            return map;
          }};
}

}  // namespace cellmap::pcl_io
