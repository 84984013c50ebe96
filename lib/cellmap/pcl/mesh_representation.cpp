#include <fcntl.h>
#include <pcl/PolygonMesh.h>
#include <pcl/conversions.h>
#include <pcl/point_types.h>
#include <pcl/surface/poisson.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <limits>

#include "cellmap/evaluation/nearest_points.hpp"
#include "cellmap/evaluation/point_bytes.hpp"
#include "cellmap/evaluation/point_registration.hpp"
#include "cellmap/pcl/pcl_representations.hpp"

namespace cellmap::pcl_io {
namespace {

constexpr double kVoxelM = 0.2, kStretchM = 100, kTrimM = 0.3;
constexpr int kDepth = 10;
constexpr std::size_t kNeighbours = 12;

/// PCL's Poisson reconstruction prints thousands of lines by printf; a library does not print. Not
/// thread safe, since there is one standard output.
class SilentOutput {
 public:
  SilentOutput() {
    std::fflush(stdout);
    kept_ = ::dup(STDOUT_FILENO);
    const int nowhere = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (nowhere >= 0) {
      ::dup2(nowhere, STDOUT_FILENO);
      ::close(nowhere);
    }
  }
  ~SilentOutput() {
    std::fflush(stdout);
    if (kept_ < 0) return;
    ::dup2(kept_, STDOUT_FILENO);
    ::close(kept_);
  }
  SilentOutput(const SilentOutput&) = delete;
  SilentOutput& operator=(const SilentOutput&) = delete;

 private:
  int kept_ = -1;
};

/// Scans of consecutive stretches of the drive.
std::vector<std::vector<const PlacedScan*>> stretches(const ComparedDrive& drive) {
  std::vector<std::vector<const PlacedScan*>> result(1);
  double driven_m = 0;
  for (std::size_t i = 0; i < drive.mapped.size(); ++i) {
    if (i > 0) {
      driven_m +=
          (drive.mapped[i].T_map_scan.translation() - drive.mapped[i - 1].T_map_scan.translation())
              .norm();
    }
    if (driven_m > kStretchM) {
      driven_m = 0;
      result.emplace_back();
    }
    result.back().push_back(&drive.mapped[i]);
  }
  return result;
}

/// Points with normals towards where the nearest scan was taken.
pcl::PointCloud<pcl::PointNormal>::Ptr oriented(const PointCloud& points, const PointCloud& path) {
  const PointCloud normals = estimate_normals(points, kNeighbours, 1);
  const NearestPoints sensors(path);
  pcl::PointCloud<pcl::PointNormal>::Ptr cloud(new pcl::PointCloud<pcl::PointNormal>);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f p = points[i], sensor = path[sensors.nearest(p).index];
    const Eigen::Vector3f n =
        normals[i].dot(sensor - p) < 0 ? Eigen::Vector3f(-normals[i]) : normals[i];
    cloud->push_back(pcl::PointNormal(p.x(), p.y(), p.z(), n.x(), n.y(), n.z()));
  }
  return cloud;
}

/// The triangles all of whose corners lie near points, with the corners that they use.
TriangleMesh trimmed(const pcl::PolygonMesh& raw, const PointCloud& points) {
  pcl::PointCloud<pcl::PointXYZ> vertices;
  pcl::fromPCLPointCloud2(raw.cloud, vertices);
  const NearestPoints tree(points);
  constexpr std::uint32_t kUnused = std::numeric_limits<std::uint32_t>::max();
  std::vector<bool> near(vertices.size());
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const auto& v = vertices[i];
    near[i] = tree.nearest({v.x, v.y, v.z}).squared_distance_m2 <= kTrimM * kTrimM;
  }
  std::vector<std::uint32_t> place(vertices.size(), kUnused);
  TriangleMesh mesh;
  for (const pcl::Vertices& polygon : raw.polygons) {
    const auto& corner = polygon.vertices;
    const auto is_near = [&](auto v) { return near[static_cast<std::size_t>(v)]; };
    if (corner.size() != 3 || !std::all_of(corner.begin(), corner.end(), is_near)) continue;
    std::array<std::uint32_t, 3> triangle;
    for (std::size_t k = 0; k < 3; ++k) {
      std::uint32_t& at = place[static_cast<std::size_t>(corner[k])];
      if (at == kUnused) {
        at = static_cast<std::uint32_t>(mesh.vertices.size());
        const auto& v = vertices[static_cast<std::size_t>(corner[k])];
        mesh.vertices.push_back({v.x, v.y, v.z});
      }
      triangle[k] = at;
    }
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

TriangleMesh reconstruct(const std::vector<const PlacedScan*>& scans) {
  PointCloud stacked, path;
  for (const PlacedScan* placed : scans) {
    stacked.append(transformed(placed->scan.points, placed->T_map_scan));
    path.push_back(placed->T_map_scan.translation().cast<float>());
  }
  const PointCloud points = voxel_means(stacked, kVoxelM);
  pcl::Poisson<pcl::PointNormal> poisson;
  poisson.setDepth(kDepth);
  poisson.setThreads(1);
  poisson.setInputCloud(oriented(points, path));
  pcl::PolygonMesh mesh;
  {
    const SilentOutput silent;
    poisson.reconstruct(mesh);
  }
  return trimmed(mesh, points);
}

DecodedMap decode_mesh(const MapFiles& files) {
  DecodedMap map;
  map.surface = mesh_of_ply(files.at(0).bytes);
  for (std::size_t t = 0; t < map.surface.triangles.size(); ++t) {
    const auto [a, b, c] = map.surface.corners(t);
    const Eigen::Vector3d normal = (b - a).cross(c - a);
    if (!(normal.norm() > 1e-9)) continue;
    map.points.push_back(((a + b + c) / 3).cast<float>());
    map.normals.push_back(normal.normalized().cast<float>());
  }
  return map;
}

}  // namespace

Representation poisson_mesh() {
  return {"mesh (Poisson)",
          [](const ComparedDrive& drive) {
            TriangleMesh mesh;
            for (const auto& scans : stretches(drive)) mesh.append(reconstruct(scans));
            return MapFiles{{"mesh.ply", ply_bytes(mesh)}};
          },
          decode_mesh};
}

std::vector<Representation> representations() {
  std::vector<Representation> all;
  for (const double voxel_m : {0.4, 0.2}) {
    for (const double step_m : {0.01, 0.05}) {
      all.push_back(octree_compressed(voxel_m, step_m));
    }
  }
  for (const double voxel_m : {0.4, 0.2}) {
    for (const double step_m : {0.01, 0.05}) {
      all.push_back(draco_compressed(voxel_m, step_m));
    }
  }
  all.push_back(poisson_mesh());
  return all;
}

}  // namespace cellmap::pcl_io
