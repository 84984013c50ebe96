#include "cellmap/cell/patch_outline.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace cellmap {
namespace {

constexpr double kRadiusRad = 0.009;

Plane plane_of(double distance_m, const Eigen::Vector3d& normal) {
  const Eigen::Vector3f n = normal.normalized().cast<float>();
  return {static_cast<float>(distance_m), n.x(), n.y(), n.z()};
}

double area_of(const std::array<Eigen::Vector3d, kOutlineCorners>& corners) {
  Eigen::Vector3d twice = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < kOutlineCorners; ++k) {
    twice += (corners[k] - corners[0]).cross(corners[(k + 1) % kOutlineCorners] - corners[0]);
  }
  return twice.norm() / 2;
}

TEST(PatchOutline, OfAPlaneSeenHeadOnHasThePatchsArea) {
  const auto corners = patch_outline(plane_of(10, {-1, 0, 0}), {1, 0, 0}, kRadiusRad);
  const double disc = std::numbers::pi * std::pow(10 * kRadiusRad, 2);
  EXPECT_NEAR(area_of(corners), disc, 1e-3 * disc);
}

TEST(PatchOutline, LiesOnThePlaneAndOnTheConeOfItsPatch) {
  const Eigen::Vector3d direction = Eigen::Vector3d(1, 2, -0.5).normalized();
  const Eigen::Vector3d normal = Eigen::Vector3d(-1, -1, 0.8).normalized();
  const auto corners = patch_outline(plane_of(20, normal), direction, kRadiusRad);
  const double offset = 20 * normal.dot(direction);
  double angle = 0;
  for (const Eigen::Vector3d& corner : corners) {
    EXPECT_NEAR(normal.dot(corner), offset, 1e-4);
    const double to_corner = std::acos(corner.normalized().dot(direction));
    if (angle == 0) angle = to_corner;
    EXPECT_NEAR(to_corner, angle, 1e-6);
    EXPECT_NEAR(to_corner, 1.1 * kRadiusRad, 1e-4);
  }
}

TEST(PatchOutline, StaysNearWhereThePlaneIsMetAtASmallAngle) {
  // At 0.5 deg a ray of the patch's edge meets the plane behind the origin or nowhere.
  for (const double degrees : {0.1, 0.5, 0.567, 1.0, 3.0}) {
    const double angle = degrees * std::numbers::pi / 180;
    const Eigen::Vector3d normal(-std::sin(angle), 0, std::cos(angle));
    const auto corners = patch_outline(plane_of(20, normal), {1, 0, 0}, kRadiusRad);
    for (const Eigen::Vector3d& corner : corners) {
      EXPECT_LE((corner - Eigen::Vector3d(20, 0, 0)).norm(), kLongestCorner * 20 + 1e-9);
      EXPECT_NEAR(normal.dot(corner), normal.x() * 20, 1e-4);
    }
    EXPECT_GT(area_of(corners), 0);
  }
}

TEST(PatchMesh, HasFourTrianglesAPlaneWhereThePoseSaysTheyAre) {
  const Lattice lattice({LatticeKind::kFibonacci, 1'000});
  Cell cell;
  cell.lattice = lattice.spec();
  cell.indices = {100, 500};
  for (const std::uint32_t index : cell.indices) {
    cell.planes.push_back(plane_of(5, -lattice.direction(index)));
  }
  Pose T = Pose::Identity();
  T.translation() << 3, -2, 1;
  const TriangleMesh mesh = patch_mesh(cell, lattice, T);
  EXPECT_EQ(mesh.vertices.size(), 2 * kOutlineCorners);
  ASSERT_EQ(mesh.triangles.size(), 2 * (kOutlineCorners - 2));
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Eigen::Vector3d direction = lattice.direction(cell.indices[i / kOutlineCorners]);
    const Eigen::Vector3d p = mesh.vertices[i].cast<double>() - T.translation();
    EXPECT_NEAR(p.dot(direction), 5, 1e-4);
  }
}

}  // namespace
}  // namespace cellmap
