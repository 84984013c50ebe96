#include "cellmap/evaluation/reconstruction_metrics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "cellmap/evaluation/surface_index.hpp"

namespace cellmap {
namespace {

/// A square of side 2 m at height `z`.
TriangleMesh square(double z) {
  TriangleMesh mesh;
  mesh.add_polygon(std::vector<Eigen::Vector3d>{{-1, -1, z}, {1, -1, z}, {1, 1, z}, {-1, 1, z}});
  return mesh;
}

PointCloud square_of_points(double z, double step_m) {
  PointCloud points;
  for (double x = -1; x <= 1; x += step_m) {
    for (double y = -1; y <= 1; y += step_m) {
      points.push_back(Eigen::Vector3d(x, y, z).cast<float>());
    }
  }
  return points;
}

Eigen::Vector3d random_point(std::mt19937& rng, double side_m) {
  std::uniform_real_distribution<double> at(-side_m, side_m);
  return {at(rng), at(rng), at(rng)};
}

/// The nearest of many points of the triangle.
double slow_distance(const Eigen::Vector3d& p, const std::array<Eigen::Vector3d, 3>& t) {
  constexpr int kSteps = 300;
  double nearest = INFINITY;
  for (int i = 0; i <= kSteps; ++i) {
    for (int k = 0; k + i <= kSteps; ++k) {
      const double u = static_cast<double>(i) / kSteps, v = static_cast<double>(k) / kSteps;
      nearest = std::min(nearest, (t[0] + u * (t[1] - t[0]) + v * (t[2] - t[0]) - p).norm());
    }
  }
  return nearest;
}

TEST(ReconstructionErrors, AreMeansAndHarmonicMeansOfSharesByHand) {
  // Within 5, 10, 20 cm: 1, 2, 3 of 4 one way; 1, 1, 2 of 2 the other.
  const std::vector<double> from_map = {0.01, 0.06, 0.15, 0.5}, from_points = {0.02, 0.12};
  const ReconstructionErrors errors = reconstruction_errors(from_map, from_points);
  EXPECT_NEAR(errors.accuracy_m, 0.18, 1e-12);
  EXPECT_NEAR(errors.completeness_m, 0.07, 1e-12);
  EXPECT_NEAR(errors.f_score[0], 2 * 0.25 * 0.5 / 0.75, 1e-12);
  EXPECT_NEAR(errors.f_score[1], 0.5, 1e-12);
  EXPECT_NEAR(errors.f_score[2], 2 * 0.75 * 1 / 1.75, 1e-12);
}

TEST(ReconstructionErrors, ScoreZeroWhereNothingIsNear) {
  const std::vector<double> far = {0.5};
  EXPECT_EQ(reconstruction_errors(far, far).f_score[2], 0.0);
}

TEST(ReconstructionErrors, AreNotSaidWithoutDistances) {
  const std::vector<double> some = {0.1};
  EXPECT_TRUE(std::isnan(reconstruction_errors({}, some).accuracy_m));
  EXPECT_TRUE(std::isnan(reconstruction_errors(some, {}).f_score[0]));
}

TEST(ReconstructionErrors, OfAPlaneThatIsOffAreItsOffsetBothWays) {
  const TriangleMesh mesh = square(0.03);
  const PointCloud points = square_of_points(0, 0.01);
  const NearestPoints tree(points);
  const ReconstructionErrors errors =
      reconstruction_errors(distances_to_points(sample_surface(mesh, 2'000), tree, 2),
                            distances_to_surface(points, mesh, 2));
  EXPECT_NEAR(errors.completeness_m, 0.03, 1e-6);
  // The nearest point is up to 7 mm sideways: sqrt(0.03^2 + 0.007^2) at most.
  EXPECT_GE(errors.accuracy_m, 0.03 - 1e-6);
  EXPECT_LE(errors.accuracy_m, std::hypot(0.03, 0.0071));
  EXPECT_EQ(errors.f_score[0], 1.0);
}

TEST(Distances, AreCutAtTheLimit) {
  const TriangleMesh mesh = square(7);
  const PointCloud points = square_of_points(0, 0.5);
  for (const double d : distances_to_surface(points, mesh, 1)) EXPECT_EQ(d, kReconstructionLimitM);
}

TEST(TriangleDistance, AgreesWithTheNearestOfManyPointsOfIt) {
  std::mt19937 rng(5);
  for (int k = 0; k < 60; ++k) {
    const std::array triangle = {random_point(rng, 1), random_point(rng, 1), random_point(rng, 1)};
    const Eigen::Vector3d p = random_point(rng, 2);
    EXPECT_NEAR(distance_to_triangle(p, triangle), slow_distance(p, triangle), 0.01);
  }
}

TEST(TriangleDistance, OfAFlatTriangleIsThatOfItsLongestEdge) {
  EXPECT_NEAR(distance_to_triangle({0, 1, 0}, {{{-1, 0, 0}, {0, 0, 0}, {1, 0, 0}}}), 1, 1e-12);
  EXPECT_NEAR(distance_to_triangle({3, 0, 4}, {{{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}}), 5, 1e-12);
}

TEST(SurfaceIndex, TellsTheNearestOfAllTriangles) {
  std::mt19937 rng(9);
  TriangleMesh mesh;
  for (int k = 0; k < 300; ++k) {
    const Eigen::Vector3d at = random_point(rng, 3);
    mesh.add_polygon(
        std::vector<Eigen::Vector3d>{at, at + random_point(rng, 0.5), at + random_point(rng, 0.5)});
  }
  const SurfaceIndex index(mesh, 0.5);
  for (int k = 0; k < 300; ++k) {
    const Eigen::Vector3d p = random_point(rng, 3.5);
    double nearest = 0.5;
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
      nearest = std::min(nearest, distance_to_triangle(p, mesh.corners(t)));
    }
    EXPECT_EQ(index.distance(p), nearest);
  }
}

TEST(SurfaceSamples, LieOnTheMeshInProportionToItsArea) {
  TriangleMesh mesh = square(0);                                                    // 4 m^2
  mesh.add_polygon(std::vector<Eigen::Vector3d>{{5, 0, 0}, {7, 0, 0}, {5, 1, 0}});  // 1 m^2
  const PointCloud samples = sample_surface(mesh, 10'000);
  ASSERT_EQ(samples.size(), 10'000u);
  std::size_t right = 0;
  const SurfaceIndex index(mesh, 0.5);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    EXPECT_LT(index.distance(samples[i].cast<double>()), 1e-5);
    right += samples.x[i] > 3;
  }
  EXPECT_NEAR(static_cast<double>(right), 2'000, 2);
}

TEST(SurfaceSamples, OfAMeshWithoutAreaAreNone) { EXPECT_TRUE(sample_surface({}, 100).empty()); }

TEST(NearestPoints, AgreeWithLookingAtAll) {
  std::mt19937 rng(3);
  PointCloud points;
  for (int k = 0; k < 500; ++k) points.push_back(random_point(rng, 2).cast<float>());
  const NearestPoints tree(points);
  for (int k = 0; k < 200; ++k) {
    const Eigen::Vector3f p = random_point(rng, 2).cast<float>();
    std::vector<float> all;
    for (std::size_t i = 0; i < points.size(); ++i) all.push_back((points[i] - p).squaredNorm());
    std::sort(all.begin(), all.end());
    EXPECT_FLOAT_EQ(tree.nearest(p).squared_distance_m2, all[0]);
    std::array<NearestPoints::Neighbour, 5> found;
    ASSERT_EQ(tree.nearest(p, found), 5u);
    for (std::size_t n = 0; n < 5; ++n) EXPECT_FLOAT_EQ(found[n].squared_distance_m2, all[n]);
  }
}

}  // namespace
}  // namespace cellmap
