#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// Triangles over shared vertices, metres. The frame is stated by whoever owns the mesh.
struct TriangleMesh {
  PointCloud vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< positions among the vertices

  bool empty() const { return triangles.empty(); }
  std::array<Eigen::Vector3d, 3> corners(std::size_t triangle) const {
    const auto& [a, b, c] = triangles[triangle];
    return {vertices[a].cast<double>(), vertices[b].cast<double>(), vertices[c].cast<double>()};
  }

  void append(const TriangleMesh& other) {
    const auto first = static_cast<std::uint32_t>(vertices.size());
    vertices.append(other.vertices);
    for (const auto& [a, b, c] : other.triangles) {
      triangles.push_back({first + a, first + b, first + c});
    }
  }

  /// A flat convex polygon as a fan of triangles; its corners in order, at least three.
  template <typename Corners>
  void add_polygon(const Corners& corners) {
    const auto first = static_cast<std::uint32_t>(vertices.size());
    for (const Eigen::Vector3d& corner : corners) vertices.push_back(corner.template cast<float>());
    const auto count = static_cast<std::uint32_t>(vertices.size()) - first;
    for (std::uint32_t k = 2; k < count; ++k) {
      triangles.push_back({first, first + k - 1, first + k});
    }
  }
};

}  // namespace cellmap
