#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

namespace cellmap::simulation {

/// Triangles in float, as the ray caster reads them.
struct TriangleMesh {
  std::vector<std::array<float, 3>> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};

/// Adds shapes, given in an object's own frame in metres, to a mesh. Surfaces are seen from both
/// sides.
class MeshBuilder {
 public:
  MeshBuilder(TriangleMesh& mesh, const Eigen::Isometry3d& T_mesh_object)
      : mesh_(mesh), T_mesh_object_(T_mesh_object) {}

  using Point = Eigen::Vector3d;
  void triangle(const Point& a, const Point& b, const Point& c);
  /// Corners in order around a flat four-sided face.
  void quad(const Point& a, const Point& b, const Point& c, const Point& d);
  void box(const Point& low, const Point& high);
  /// Four bottom and four top corners, both counter-clockwise seen from above; closed.
  void hexahedron(const std::array<Point, 4>& bottom, const std::array<Point, 4>& top);
  /// An upright round shaft from `foot`, without its ends.
  void shaft(const Point& foot, double height, double foot_radius, double top_radius, int sides);

 private:
  std::uint32_t add(const Point& p);

  TriangleMesh& mesh_;
  Eigen::Isometry3d T_mesh_object_;
};

}  // namespace cellmap::simulation
