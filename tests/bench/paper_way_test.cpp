#include "bench/paper_way.hpp"

#include <gtest/gtest.h>

#include <array>
#include <random>

#include "bench/ceres_example.hpp"
#include "bench/loopy_graph.hpp"
#include "bench/measure.hpp"
#include "bench/naive_codec.hpp"
#include "support/registration_world.hpp"

// The baselines must do their work right, or the benchmark's ratios say nothing.
namespace cellmap::bench {
namespace {

using test::level_pose;

class PaperWay : public ::testing::Test {
 protected:
  const test::BoxScene scene_ = test::street();
  const std::shared_ptr<const Lattice> lattice_ =
      std::make_shared<const Lattice>(LatticeSpec{LatticeKind::kFibonacci, 20'000});
  const LatticeTree tree_{*lattice_};
};

TEST_F(PaperWay, TreeFindsANearestLatticePointWithinFloatPrecision) {
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3f p(normal(random), normal(random), normal(random));
    const Eigen::Vector3d unit = p.cast<double>().normalized();
    double best = -1;
    for (std::uint32_t j = 0; j < lattice_->size(); ++j) {
      best = std::max(best, lattice_->direction(j).dot(unit));
    }
    EXPECT_NEAR(lattice_->direction(tree_.nearest(p)).dot(unit), best, 1e-7);
  }
}

TEST_F(PaperWay, CellHoldsTheWallsOfTheScene) {
  const PointCloud scan = scene_.scan(level_pose(0, 0, 0));
  const PaperCell cell = build_cell_paper_way(scan, tree_, 1);
  ASSERT_GT(cell.valid(), 1'000u);
  std::size_t checked = 0, right = 0;
  for (std::uint32_t j = 0; j < tree_.size(); ++j) {
    if (cell.planes[j].distance_m == 0) continue;
    const Eigen::Vector3d ray = lattice_->direction(j);
    const double truth = scene_.cast(Eigen::Vector3d::Zero(), ray);
    ++checked;
    right += std::abs(cell.planes[j].distance_m - truth) < 0.05 ? 1 : 0;
  }
  // Patches that straddle an edge may have a plane of either side.
  EXPECT_GT(static_cast<double>(right), 0.9 * static_cast<double>(checked));
}

TEST_F(PaperWay, ThreadCountDoesNotChangeTheCell) {
  const PointCloud scan = scene_.scan(level_pose(0, 0, 0));
  EXPECT_EQ(build_cell_paper_way(scan, tree_, 1).planes,
            build_cell_paper_way(scan, tree_, 2).planes);
}

TEST_F(PaperWay, RegistrationReturnsToTheTruePoseInBothDirections) {
  const Pose T_world_a = level_pose(0, 0, 0), T_world_b = level_pose(6, 0.3, 4);
  const PointCloud scan_a = scene_.scan(T_world_a), scan_b = scene_.scan(T_world_b);
  const PaperCell a = build_cell_paper_way(scan_a, tree_, 1);
  const PaperCell b = build_cell_paper_way(scan_b, tree_, 1);
  const Pose T_a_b = T_world_a.inverse() * T_world_b;
  const PointCloud some_of_a = every_nth(scan_a, 8), some_of_b = every_nth(scan_b, 8);
  const std::array forward = {PaperTerm{&a, &some_of_b}};
  const std::array reverse = {PaperTerm{&b, &some_of_a, true}};
  const std::array both = {forward[0], reverse[0]};
  for (const std::span<const PaperTerm> terms :
       {std::span<const PaperTerm>(forward), std::span<const PaperTerm>(reverse),
        std::span<const PaperTerm>(both)}) {
    for (const JacobianSize size : {JacobianSize::kDynamic, JacobianSize::kFixed}) {
      const Pose guess = level_pose(0.1, -0.05, 0.5) * T_a_b;
      const PaperRegistration options{.iterations = 15, .gate_m = 0.5, .jacobians = size};
      const Pose T = register_paper_way(terms, tree_, guess, options);
      EXPECT_LT((T.translation() - T_a_b.translation()).norm(), 0.03);
      EXPECT_LT(angle_between_rad(T, T_a_b), 0.002);
    }
  }
  EXPECT_GT(inlier_ratio_paper_way(forward[0], tree_, T_a_b, 1), 0.5);
}

TEST(CeresExample, FindsTheMinimumThatTheProductFinds) {
  const PoseGraph start = loopy_graph(street_grid_poses(300), 3);
  PoseGraph example = start, ours = start;
  optimize_as_ceres_example(example, 1);
  PoseGraphOptions plain;
  plain.loop_loss_scale = 0;
  const PoseGraphSummary solved = optimize(ours, plain);
  EXPECT_LT(solved.final_cost, 0.5 * solved.initial_cost);
  EXPECT_NEAR(optimize(example, plain).initial_cost, solved.final_cost, 2e-3 * solved.final_cost);
}

TEST(NaiveCodec, DecodesWhatItEncoded) {
  const Cell cell = test::target_at(test::street(), level_pose(0, 0, 0)).cell();
  const Cell decoded = naive_decode(naive_decompress(naive_compress(naive_encode(cell))));
  EXPECT_EQ(decoded.indices, cell.indices);
  EXPECT_EQ(decoded.planes, cell.planes);
  EXPECT_EQ(decoded.T_odom_cell.matrix(), cell.T_odom_cell.matrix());
}

TEST(Compare, RunsBothSidesInTurnAndPreparesEachRun) {
  std::string calls;
  compare({[&] { calls += 'A'; }, [&] { calls += 'a'; }},
          {[&] { calls += 'B'; }, [&] { calls += 'b'; }},
          {.seconds = 0, .min_pairs = 2, .warm_up = false});
  EXPECT_EQ(calls, "aAbBaAbB");
}

}  // namespace
}  // namespace cellmap::bench
