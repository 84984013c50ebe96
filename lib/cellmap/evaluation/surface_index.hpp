#pragma once

#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "cellmap/geometry/triangle_mesh.hpp"

namespace cellmap {

/// The distance of a point from a triangle (which may be flat), metres.
double distance_to_triangle(const Eigen::Vector3d& p,
                            const std::array<Eigen::Vector3d, 3>& triangle);

/// How far points are from a mesh that stays where it is: triangles in a grid of voxels as long as
/// the largest distance that is told. Immutable and safe to share between threads. Memory: 4 bytes
/// for each voxel that a triangle's box touches.
class SurfaceIndex {
 public:
  /// Distances above `limit_m` > 0 are told as `limit_m`.
  SurfaceIndex(const TriangleMesh& mesh, double limit_m);

  double distance(const Eigen::Vector3d& p) const;

 private:
  const TriangleMesh& mesh_;
  double limit_m_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> voxels_;
};

/// `count` points spread evenly over the mesh's area: at equal steps along the triangles in their
/// order. Deterministic. None where the mesh has no area.
PointCloud sample_surface(const TriangleMesh& mesh, std::size_t count);

}  // namespace cellmap
