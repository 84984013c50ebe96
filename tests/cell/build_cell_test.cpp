#include "cellmap/cell/build_cell.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <random>

#include "cellmap/cell/plane_fit.hpp"
#include "support/box_scene.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::BoxScene;
using test::level_pose;

LocalMap local_map_of(const BoxScene& scene, double noise_m = 0) {
  const BoxScene::Sensor sensor{.noise_m = noise_m};
  LocalMap map(Scan{.stamp = 10, .points = scene.scan(level_pose(0, 0, 0), sensor)},
               level_pose(0, 0, 0), 5);
  const Pose T = level_pose(1.5, 0, 1);
  map.add(Scan{.stamp = 20, .points = scene.scan(T, sensor)}, T);
  return map;
}

LocalMap local_map_of(PointCloud points) {
  return {Scan{.points = std::move(points)}, Pose::Identity(), 0};
}

/// Points spread evenly over the patch of one lattice point, at the ranges given in turn.
PointCloud patch_points(const Lattice& lattice, std::uint32_t index,
                        const std::vector<double>& ranges) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<double> uniform(-0.4, 0.4);
  PointCloud points;
  for (const double range : ranges) {
    Eigen::Vector3d offset(uniform(rng), uniform(rng), uniform(rng));
    const Eigen::Vector3d d = lattice.direction(index) + lattice.patch_radius_rad() * offset;
    points.push_back((range * d.normalized()).cast<float>());
  }
  return points;
}

TEST(LocalMap, IsCompleteStrictlyBeyondItsDistance) {
  const LocalMap map(Scan{}, level_pose(1, 0, 0), 0);
  EXPECT_FALSE(map.is_complete_for(level_pose(7, 0, 90), 6.0));
  EXPECT_TRUE(map.is_complete_for(level_pose(7.001, 0, 90), 6.0));
}

TEST(LocalMap, StacksScansInTheFrameOfItsBase) {
  LocalMap map(Scan{}, level_pose(1, 0, 90), 0);
  PointCloud point;
  point.push_back({1, 0, 0});
  map.add(Scan{.stamp = 3, .points = point}, level_pose(1, 2, 90));
  ASSERT_EQ(map.points().size(), 1U);
  EXPECT_LT((map.points()[0] - Eigen::Vector3f(3, 0, 0)).norm(), 1e-6);
  EXPECT_EQ(map.scans().size(), 2U);
  EXPECT_EQ(map.scans()[1].stamp, 3);
}

TEST(BuildCell, PlanesOfAnExactWorldLieOnItsSurfaces) {
  BoxScene room;
  room.add({-12, -9, -1.7}, {15, 7, 4});
  const Lattice lattice(LatticeSpec{});
  Cell cell = build_cell(local_map_of(room), lattice, {});
  cell.session = "test";
  validate(cell);
  ASSERT_GT(cell.planes.size(), 5'000U);
  std::size_t on_surface = 0;
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const double truth = room.cast({0, 0, 0}, lattice.direction(cell.indices[k]));
    on_surface += std::abs(cell.planes[k].distance_m - truth) < 1e-3;
  }
  // Patches on the edges of the room hold two walls.
  EXPECT_GT(static_cast<double>(on_surface), 0.93 * static_cast<double>(cell.planes.size()));
}

TEST(BuildCell, KeepsStampsAndCountsEveryPatchOnce) {
  const Lattice lattice(LatticeSpec{});
  const LocalMap map = local_map_of(test::street(), 0.02);
  const Cell cell = build_cell(map, lattice, {});
  const CellStatistics& s = cell.statistics;
  EXPECT_EQ(cell.first_stamp, 10);
  EXPECT_EQ(cell.last_stamp, 20);
  EXPECT_EQ(cell.first_scan, 5U);
  EXPECT_EQ(cell.scan_count, 2U);
  EXPECT_EQ(s.points, map.points().size());
  EXPECT_EQ(s.patches_hit, cell.planes.size() + s.rejected_few_points + s.rejected_gap +
                               s.rejected_planarity + s.rejected_grazing);
}

TEST(BuildCell, TheResultDoesNotDependOnTheThreads) {
  const Lattice lattice(LatticeSpec{});
  const LocalMap map = local_map_of(test::street(), 0.02);
  for (const PlaneFit fit : {PlaneFit::kTrimmed, PlaneFit::kRansac}) {
    const Cell serial = build_cell(map, lattice, {.fit = fit, .threads = 1});
    const Cell parallel = build_cell(map, lattice, {.fit = fit, .threads = 4});
    EXPECT_EQ(serial.indices, parallel.indices);
    EXPECT_EQ(serial.planes, parallel.planes);
    EXPECT_EQ(serial.statistics, parallel.statistics);
  }
}

TEST(BuildCell, RansacAndTheTrimmedFitAgreeOnWalls) {
  const Lattice lattice(LatticeSpec{});
  const LocalMap map = local_map_of(test::street(), 0.01);
  const Cell trimmed = build_cell(map, lattice, {});
  const Cell ransac = build_cell(map, lattice, {.fit = PlaneFit::kRansac});
  std::vector<double> difference;
  for (std::size_t i = 0, j = 0; i < trimmed.indices.size() && j < ransac.indices.size();) {
    if (trimmed.indices[i] != ransac.indices[j]) {
      trimmed.indices[i] < ransac.indices[j] ? ++i : ++j;
      continue;
    }
    difference.push_back(std::abs(trimmed.planes[i++].distance_m - ransac.planes[j++].distance_m));
  }
  ASSERT_GT(difference.size(), 3'000U);
  std::nth_element(difference.begin(), difference.begin() + difference.size() / 2,
                   difference.end());
  EXPECT_LT(difference[difference.size() / 2], 0.01);
}

TEST(BuildCell, AGapIsFoundWhereverItIsAlsoBeforeTheLastPoint) {
  const Lattice lattice(LatticeSpec{});
  const auto gaps = [&](std::vector<double> ranges) {
    const Cell cell = build_cell(local_map_of(patch_points(lattice, 25'000, ranges)), lattice, {});
    return cell.statistics.rejected_gap;
  };
  EXPECT_EQ(gaps({20, 20.1, 20.2, 20, 20.1, 20.2, 20}), 0U);
  EXPECT_EQ(gaps({20, 20.1, 20.2, 20, 20.1, 20.2, 23.3}), 1U);
  EXPECT_EQ(gaps({16.9, 20.1, 20.2, 20, 20.1, 20.2, 20}), 1U);
  EXPECT_EQ(gaps({20, 20.1, 25, 25, 20, 25, 25}), 1U);
  EXPECT_EQ(gaps({20, 22.9, 25.8, 28.7, 22.9, 20, 28.7}), 0U);
}

TEST(BuildCell, PatchesWithTooFewPointsKeepNoPlane) {
  const Lattice lattice(LatticeSpec{});
  const PointCloud five = patch_points(lattice, 25'000, {20, 20, 20, 20, 20});
  const Cell cell = build_cell(local_map_of(five), lattice, {});
  EXPECT_TRUE(cell.planes.empty());
  EXPECT_EQ(cell.statistics.rejected_few_points, 1U);
}

TEST(BuildCell, PointsOnALineHoldNoPlane) {
  const Lattice lattice(LatticeSpec{});
  const Eigen::Vector3d centre = 20 * lattice.direction(25'000);
  PointCloud line;
  for (int i = -5; i <= 5; ++i) {
    line.push_back((centre + 0.01 * i * Eigen::Vector3d::UnitZ()).cast<float>());
  }
  const Cell cell = build_cell(local_map_of(line), lattice, {});
  EXPECT_TRUE(cell.planes.empty());
  EXPECT_EQ(cell.statistics.rejected_planarity, 1U);
}

TEST(BuildCell, AnEmptyLocalMapMakesAnEmptyCell) {
  const Cell cell = build_cell(local_map_of(PointCloud{}), Lattice(LatticeSpec{}), {});
  EXPECT_TRUE(cell.planes.empty());
  EXPECT_EQ(cell.statistics, CellStatistics{});
}

TEST(FitPlane, IsTheSmallestEigenvectorOfTheCovariance) {
  std::mt19937 rng(2);
  std::normal_distribution<double> normal;
  for (int trial = 0; trial < 200; ++trial) {
    const Eigen::Vector3d scale(1, std::pow(10, -0.02 * trial), 1e-3 * (1 + trial % 7));
    const Eigen::Matrix3d R = Eigen::Quaterniond::UnitRandom().toRotationMatrix();
    PointCloud cloud;
    for (int i = 0; i < 20; ++i) {
      const Eigen::Vector3d p(normal(rng), normal(rng), normal(rng));
      cloud.push_back((R * scale.cwiseProduct(p) + Eigen::Vector3d(30, -20, 5)).cast<float>());
    }
    PatchPoints points(cloud.x.data(), cloud.y.data(), cloud.z.data(), cloud.size());
    points.keep(cloud.size());
    Eigen::Matrix3Xd P(3, points.size());
    for (std::size_t i = 0; i < points.size(); ++i) P.col(i) = points[i];
    const Eigen::Vector3d mean = P.rowwise().mean();
    const Eigen::Matrix3d C = (P.colwise() - mean) * (P.colwise() - mean).transpose() / 20;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> twin(C);
    const std::optional<FittedPlane> plane = fit_plane(points);
    ASSERT_TRUE(plane);
    EXPECT_NEAR(std::abs(plane->normal.dot(twin.eigenvectors().col(0))), 1.0, 1e-6);
    EXPECT_NEAR(plane->variance_across_m2, twin.eigenvalues()[0], 1e-9);
    EXPECT_NEAR(plane->variance_within_m2, twin.eigenvalues()[1], 1e-9);
    EXPECT_LT((plane->centroid - mean).norm(), 1e-9);
  }
}

TEST(ValidateCell, NamesTheFirstBrokenRule) {
  const Lattice lattice(LatticeSpec{});
  Cell good = build_cell(local_map_of(test::street()), lattice, {});
  good.session = "drive-1.a_B";
  EXPECT_NO_THROW(validate(good));
  const auto broken = [&](const auto& damage, const std::string& rule) {
    Cell cell = good;
    damage(cell);
    test::expect_error(
        ErrorCode::kCorruptData, [&] { validate(cell); }, rule);
  };
  broken([](Cell& c) { c.indices.pop_back(); }, "indices");
  broken([](Cell& c) { std::swap(c.indices[0], c.indices[1]); }, "increasing");
  broken([](Cell& c) { c.indices.back() = 50'000; }, "outside its lattice");
  broken([](Cell& c) { c.planes[3].nx = NAN; }, "unit");
  broken([](Cell& c) { c.planes[3].distance_m = 0; }, "distance");
  broken([](Cell& c) { c.planes[3].distance_m = 10'001; }, "distance");
  broken([](Cell& c) { c.planes[3].nx *= -1, c.planes[3].ny *= -1, c.planes[3].nz *= -1; },
         "face the origin");
  broken([](Cell& c) { c.session = "a/b"; }, "session");
  broken([](Cell& c) { c.session.clear(); }, "session");
  broken([](Cell& c) { c.last_stamp = c.first_stamp - 1; }, "stamp");
  broken([](Cell& c) { c.T_odom_cell.linear() *= 2; }, "rigid");
}

TEST(ReconstructPoints, GivesOnePointAPlaneAtItsDistance) {
  const Lattice lattice(LatticeSpec{});
  const Cell cell = build_cell(local_map_of(test::street()), lattice, {});
  const PointCloud points = reconstruct_points(cell, lattice);
  ASSERT_EQ(points.size(), cell.planes.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    EXPECT_NEAR(points[k].norm(), cell.planes[k].distance_m, 1e-4);
    EXPECT_EQ(lattice.nearest(points[k].cast<double>()), cell.indices[k]);
  }
}

TEST(CellBuildOptions, ValuesOutOfTheirRangesAreRefusedByName) {
  test::expect_error(
      ErrorCode::kInvalidArgument, [] { CellBuildOptions{.min_points = 2}.validate(); },
      "min_points");
  test::expect_error(
      ErrorCode::kInvalidArgument, [] { CellBuildOptions{.max_range_gap_m = NAN}.validate(); },
      "max_range_gap_m");
}

}  // namespace
}  // namespace cellmap
