#include "cellmap/simulation/mesh.hpp"

#include <cmath>
#include <numbers>

namespace cellmap::simulation {

std::uint32_t MeshBuilder::add(const Point& p) {
  const Eigen::Vector3f placed = (T_mesh_object_ * p).cast<float>();
  mesh_.vertices.push_back({placed.x(), placed.y(), placed.z()});
  return static_cast<std::uint32_t>(mesh_.vertices.size() - 1);
}

void MeshBuilder::triangle(const Point& a, const Point& b, const Point& c) {
  const std::uint32_t first = add(a);
  add(b);
  add(c);
  mesh_.triangles.push_back({first, first + 1, first + 2});
}

void MeshBuilder::quad(const Point& a, const Point& b, const Point& c, const Point& d) {
  const std::uint32_t first = add(a);
  add(b);
  add(c);
  add(d);
  mesh_.triangles.push_back({first, first + 1, first + 2});
  mesh_.triangles.push_back({first, first + 2, first + 3});
}

void MeshBuilder::hexahedron(const std::array<Point, 4>& bottom, const std::array<Point, 4>& top) {
  quad(bottom[0], bottom[1], bottom[2], bottom[3]);
  quad(top[0], top[1], top[2], top[3]);
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t j = (i + 1) % 4;
    quad(bottom[i], bottom[j], top[j], top[i]);
  }
}

void MeshBuilder::box(const Point& low, const Point& high) {
  const auto ring = [&](double z) {
    return std::array<Point, 4>{Point(low.x(), low.y(), z), Point(high.x(), low.y(), z),
                                Point(high.x(), high.y(), z), Point(low.x(), high.y(), z)};
  };
  hexahedron(ring(low.z()), ring(high.z()));
}

void MeshBuilder::shaft(const Point& foot, double height, double foot_radius, double top_radius,
                        int sides) {
  const auto rim = [&](int i, double radius, double z) {
    const double angle = 2 * std::numbers::pi * i / sides;
    return Point(foot + Point(radius * std::cos(angle), radius * std::sin(angle), z));
  };
  for (int i = 0; i < sides; ++i) {
    quad(rim(i, foot_radius, 0), rim(i + 1, foot_radius, 0), rim(i + 1, top_radius, height),
         rim(i, top_radius, height));
  }
}

}  // namespace cellmap::simulation
