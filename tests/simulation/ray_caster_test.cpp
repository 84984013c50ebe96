#include "cellmap/simulation/ray_caster.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "cellmap/simulation/town.hpp"
#include "cellmap/simulation/town_tiles.hpp"

namespace cellmap::simulation {
namespace {

using Eigen::Vector3d;

/// The slow twin: every triangle against every ray, in double (Moller and Trumbore).
double nearest_hit(const std::vector<RayCaster::Instance>& instances, const Vector3d& origin,
                   const Vector3d& direction) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& instance : instances) {
    const TriangleMesh& mesh = triangles_of(*instance.mesh);
    const Pose T = instance.T_world_mesh.inverse();
    const Vector3d o = T * origin, d = T.linear() * direction;
    for (const auto& triangle : mesh.triangles) {
      const auto corner = [&](std::size_t k) {
        const auto& v = mesh.vertices[triangle[k]];
        return Vector3d(v[0], v[1], v[2]);
      };
      const Vector3d a = corner(0), ab = corner(1) - a, ac = corner(2) - a;
      const Vector3d p = d.cross(ac);
      const double determinant = ab.dot(p);
      if (determinant == 0) continue;
      const double u = (o - a).dot(p) / determinant;
      const Vector3d q = (o - a).cross(ab);
      const double v = d.dot(q) / determinant, t = ac.dot(q) / determinant;
      if (u >= 0 && v >= 0 && u + v <= 1 && t > 0) nearest = std::min(nearest, t);
    }
  }
  return nearest;
}

std::vector<Eigen::Vector3f> random_directions(std::size_t count) {
  std::mt19937 rng(7);
  std::uniform_real_distribution<float> azimuth(-3.14159f, 3.14159f), elevation(-0.45f, 0.25f);
  std::vector<Eigen::Vector3f> directions;
  for (std::size_t i = 0; i < count; ++i) {
    const float a = azimuth(rng), e = elevation(rng);
    directions.emplace_back(std::cos(e) * std::cos(a), std::cos(e) * std::sin(a), std::sin(e));
  }
  return directions;
}

TEST(RayCaster, AgreesWithEveryTriangleTriedInTurn) {
  const Route route = town_route(10);
  const Centreline line(route);
  const Ground ground(line, 1.73, 1);
  const RayCaster caster;
  TownTiles tiles(caster, ground, plan_town(line, ground, 1, 1));
  const Pose T_world_sensor = route[300].pose * Eigen::Translation3d(0, 0, 1.73);
  const Vector3d origin = T_world_sensor.translation();
  auto instances = tiles.around(origin.x(), origin.y(), 120);
  TriangleMesh car;
  add_vehicle(1, MeshBuilder(car, Pose::Identity()));
  const Pose T_sensor_car =
      Eigen::Translation3d(9, 4, -1.73) * Eigen::AngleAxisd(0.8, Vector3d::UnitZ());
  instances.push_back({caster.build(std::move(car)), T_world_sensor * T_sensor_car});
  const auto directions = random_directions(300);
  std::vector<RayCaster::Hit> hits(directions.size());
  caster.cast(instances, T_world_sensor, directions, 120, 1, hits);

  std::size_t differ = 0, hit = 0;
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const Vector3d direction = T_world_sensor.linear() * directions[i].cast<double>();
    const double twin = nearest_hit(instances, origin, direction);
    const double expected = twin <= 120 ? twin : 0.0;
    hit += expected > 0;
    differ += std::abs(hits[i].range_m - expected) > 1e-4;
  }
  EXPECT_GT(hit, 200u);
  // A ray may pass a silhouette on the other side in float; none of 300 is expected to.
  EXPECT_LE(differ, 1u);
}

TEST(RayCaster, GivesTheAngleAtWhichASurfaceIsMet) {
  const RayCaster caster;
  TriangleMesh mesh;
  MeshBuilder(mesh, Pose::Identity()).quad({10, -9, -9}, {10, 9, -9}, {10, 9, 9}, {10, -9, 9});
  const std::vector<RayCaster::Instance> wall = {{caster.build(std::move(mesh)), Pose::Identity()}};
  const std::vector<Eigen::Vector3f> directions = {
      {1, 0, 0}, Eigen::Vector3f(1, 0.5f, 0).normalized(), {-1, 0, 0}};
  std::vector<RayCaster::Hit> hits(3);
  caster.cast(wall, Pose::Identity(), directions, 120, 1, hits);

  EXPECT_NEAR(hits[0].range_m, 10, 1e-6);
  EXPECT_NEAR(hits[0].cosine_incidence, 1, 1e-6);
  EXPECT_NEAR(hits[1].range_m, 10 * std::sqrt(1.25), 1e-5);
  EXPECT_NEAR(hits[1].cosine_incidence, 1 / std::sqrt(1.25), 1e-6);
  EXPECT_EQ(hits[2].range_m, 0);
}

TEST(RayCaster, SeesNothingBeyondItsRangeAndNothingInAnEmptyWorld) {
  const RayCaster caster;
  TriangleMesh mesh;
  MeshBuilder(mesh, Pose::Identity()).quad({50, -9, -9}, {50, 9, -9}, {50, 9, 9}, {50, -9, 9});
  const std::vector<RayCaster::Instance> wall = {{caster.build(std::move(mesh)), Pose::Identity()},
                                                 {caster.build({}), Pose::Identity()}};
  const std::vector<Eigen::Vector3f> ahead = {{1, 0, 0}};
  std::vector<RayCaster::Hit> hits(1);

  caster.cast(wall, Pose::Identity(), ahead, 49, 1, hits);
  EXPECT_EQ(hits[0].range_m, 0);
  caster.cast(wall, Pose::Identity(), ahead, 51, 1, hits);
  EXPECT_NEAR(hits[0].range_m, 50, 1e-5);
  caster.cast({}, Pose::Identity(), ahead, 51, 1, hits);
  EXPECT_EQ(hits[0].range_m, 0);
}

}  // namespace
}  // namespace cellmap::simulation
