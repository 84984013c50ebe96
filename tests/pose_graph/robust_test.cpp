#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/chains.hpp"
#include "cellmap/pose_graph/edit.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {
namespace {

constexpr std::uint32_t kRound = 40;  ///< nodes of one round of the block
constexpr double kMeasuredSigmaM = 0.05, kMeasuredSigmaRad = 0.002;

Tangent measurement_noise(std::mt19937& rng) {
  std::normal_distribution<double> normal;
  Tangent xi;
  for (int i = 0; i < 6; ++i) xi[i] = normal(rng) * (i < 3 ? kMeasuredSigmaM : kMeasuredSigmaRad);
  return xi;
}

Pose truth(std::uint32_t i) {
  const double angle = 2 * M_PI * i / kRound;
  Pose T = Pose::Identity();
  T.translation() << kRound * std::cos(angle), 0.7 * kRound * std::sin(angle), std::sin(2 * angle);
  T.rotate(Eigen::AngleAxisd(angle + M_PI / 2, Eigen::Vector3d::UnitZ()));
  return T;
}

/// A graph whose true poses are known, with what is true of each constraint.
struct World {
  PoseGraph graph;
  std::map<CellId, Pose> truth;
  std::vector<bool> is_true;

  void tie(std::uint32_t from, std::uint32_t to, const Pose& T_from_to, ConstraintKind kind,
           bool is_right, std::mt19937& rng) {
    Constraint c;
    c.id = {static_cast<std::uint32_t>(graph.constraints.size() + 1)};
    c.from = {from};
    c.to = {to};
    c.T_from_to = exp(measurement_noise(rng)) * T_from_to;
    c.kind = kind;
    c.information.diagonal().head<3>().setConstant(1 / (kMeasuredSigmaM * kMeasuredSigmaM));
    c.information.diagonal().tail<3>().setConstant(1 / (kMeasuredSigmaRad * kMeasuredSigmaRad));
    graph.constraints.push_back(c);
    is_true.push_back(is_right);
  }
  Pose between(std::uint32_t a, std::uint32_t b) const {
    return truth.at({a}).inverse() * truth.at({b});
  }

  /// A session of nodes first, first + 1, ... that drives `count` steps from `begin` on the block,
  /// its odometry in a frame of its own.
  void drive(std::uint32_t first, std::uint32_t begin, std::uint32_t count, const Pose& T_map_odom,
             std::mt19937& rng) {
    for (std::uint32_t i = 0; i < count; ++i) {
      truth[{first + i}] = cellmap::truth(begin + i);
      if (i == 0) {
        graph.nodes[{first}] = T_map_odom;
        continue;
      }
      tie(first + i - 1, first + i, between(first + i - 1, first + i),
          ConstraintKind::kBidirectional, true, rng);
      graph.nodes[{first + i}] =
          graph.nodes.at({first + i - 1}) * graph.constraints.back().T_from_to;
    }
  }

  void true_loop(std::uint32_t from, std::uint32_t to, std::mt19937& rng) {
    tie(from, to, between(from, to), ConstraintKind::kLoop, true, rng);
  }

  /// Places that look alike: `count` neighbours of `from` are taken for those of `to`.
  void false_loops(std::uint32_t from, std::uint32_t to, std::uint32_t count, std::mt19937& rng) {
    const Pose T = exp(Tangent(20 * measurement_noise(rng)));
    for (std::uint32_t i = 0; i < count; ++i) {
      const Pose T_here = between(from, from + i).inverse() * T * between(to, to + i);
      tie(from + i, to + i, T_here, ConstraintKind::kLoop, false, rng);
    }
  }

  /// RMS distance from the truth, in the frame of the first node.
  double error_m() const {
    const auto& [first, T_first] = *graph.nodes.begin();
    const Pose T = truth.at(first) * T_first.inverse();
    double sum = 0;
    for (const auto& [id, pose] : graph.nodes) {
      sum += (T * pose.translation() - truth.at(id).translation()).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(graph.nodes.size()));
  }

  std::size_t misjudged() const {
    std::size_t count = 0;
    for (std::size_t i = 0; i < is_true.size(); ++i) {
      count += (graph.constraints[i].weight > 0) != is_true[i];
    }
    return count;
  }
};

/// Three rounds; every fourth node closes a loop to the round before. Then false closures in
/// groups that agree among themselves.
World rounds(double false_share, unsigned seed) {
  std::mt19937 rng(seed);
  World world;
  world.drive(0, 0, 3 * kRound, truth(0), rng);
  std::uint32_t true_loops = 0;
  for (std::uint32_t i = kRound; i < 3 * kRound; i += 4, ++true_loops) {
    world.true_loop(i - kRound, i, rng);
  }
  auto missing = static_cast<std::uint32_t>(
      std::lround(false_share / (1 - false_share) * static_cast<double>(true_loops)));
  while (missing > 0) {
    const std::uint32_t from = rng() % kRound, to = from + kRound / 2 + rng() % kRound;
    const std::uint32_t count = std::min(missing, 1 + static_cast<std::uint32_t>(rng() % 4));
    world.false_loops(from, to, count, rng);
    missing -= count;
  }
  return world;
}

class FalseClosures : public testing::TestWithParam<LoopRobustness> {};

TEST_P(FalseClosures, DoNotCountAndCostNoAccuracy) {
  PoseGraphOptions options;
  options.robustness = GetParam();
  for (unsigned seed = 1; seed <= 5; ++seed) {
    World clean = rounds(0, seed);
    ASSERT_TRUE(optimize(clean.graph, options).converged);
    for (const double share : {0.25, 0.5, 0.75}) {
      World world = rounds(share, seed);
      const PoseGraphSummary summary = optimize(world.graph, options);
      EXPECT_TRUE(summary.converged);
      EXPECT_LE(world.error_m(), 1.02 * clean.error_m()) << share << " seed " << seed;
      EXPECT_EQ(world.misjudged(), 0u) << share << " seed " << seed;
      EXPECT_EQ(summary.rejected, static_cast<std::size_t>(std::count(world.is_true.begin(),
                                                                      world.is_true.end(), false)));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(, FalseClosures,
                         testing::Values(LoopRobustness::kApproach, LoopRobustness::kGraduated),
                         [](const auto& info) {
                           return info.index == 0 ? "Approach" : "Graduated";
                         });

TEST(Rejection, IsRememberedSoThatTheNextSolutionTakesAStep) {
  World world = rounds(0.5, 3);
  optimize(world.graph);
  const auto before = world.graph.nodes;
  const PoseGraphSummary again = optimize(world.graph);
  EXPECT_LE(again.iterations, 1);
  EXPECT_EQ(again.moved, 0u);
  for (const auto& [id, T] : before) EXPECT_EQ(T.matrix(), world.graph.nodes.at(id).matrix());
}

/// One false loop agrees with the odometry's drift for want of anything else; true loops refute it.
TEST(Rejection, IsReconsideredWhenLoopsArrive) {
  std::mt19937 rng(7);
  World world;
  world.drive(0, 0, 2 * kRound, truth(0), rng);
  world.tie(2, kRound, Pose::Identity(), ConstraintKind::kLoop, false, rng);  // 12 m off
  optimize(world.graph);
  for (std::uint32_t i = kRound + 2; i < 2 * kRound; i += 3) {
    world.true_loop(i - kRound, i, rng);
    optimize(world.graph);
  }
  EXPECT_EQ(world.misjudged(), 0u);
  EXPECT_LT(world.error_m(), 0.3);
}

TEST(Rejection, ChiSquareAndWeightAreThoseOfTheFinalPoses) {
  World world = rounds(0.25, 2);
  optimize(world.graph);
  for (const Constraint& c : world.graph.constraints) {
    const ConstraintReport report = explain(world.graph, c.id);
    EXPECT_NEAR(report.chi2, c.chi2, 1e-9 * (1 + c.chi2));
    if (report.verdict == Verdict::kAccepted) {
      EXPECT_EQ(c.weight, 1.0);
      EXPECT_LE(c.chi2, 16);
      EXPECT_LT(report.gap_m, 6 * kMeasuredSigmaM);
    }
    if (report.verdict == Verdict::kRejected) {
      EXPECT_EQ(c.weight, 0.0);
      EXPECT_GT(c.chi2, 64);
      EXPECT_GT(report.gap_m, 5);
    }
    EXPECT_EQ(report.verdict == Verdict::kTrusted, c.kind != ConstraintKind::kLoop);
  }
}

TEST(Pinned, ALoopIsNeverRejectedAndPullsInFull) {
  World world = rounds(0, 4);
  std::mt19937 rng(5);
  world.false_loops(3, 23, 1, rng);
  const ConstraintId id = world.graph.constraints.back().id;
  optimize(world.graph);
  ASSERT_EQ(verdict(find_constraint(world.graph, id)), Verdict::kRejected);
  const double gap_rejected = explain(world.graph, id).gap_m;

  set_pinned(world.graph, id, true);
  optimize(world.graph);
  EXPECT_EQ(verdict(find_constraint(world.graph, id)), Verdict::kPinned);
  EXPECT_EQ(find_constraint(world.graph, id).weight, 1.0);
  EXPECT_LT(explain(world.graph, id).gap_m, 0.5 * gap_rejected);

  set_pinned(world.graph, id, false);
  optimize(world.graph);
  EXPECT_EQ(verdict(find_constraint(world.graph, id)), Verdict::kRejected);
  EXPECT_EQ(world.misjudged(), 0u);
}

TEST(Erased, AConstraintPullsNoMore) {
  World with = rounds(0, 6), without = with;
  std::mt19937 rng(5);
  with.false_loops(3, 23, 1, rng);
  const ConstraintId id = with.graph.constraints.back().id;
  set_pinned(with.graph, id, true);
  optimize(with.graph);
  erase_constraint(with.graph, id);
  optimize(with.graph);
  optimize(without.graph);
  for (const auto& [node, T] : without.graph.nodes) {
    EXPECT_LT((with.graph.nodes.at(node).translation() - T.translation()).norm(), 1e-3);
  }
  EXPECT_THROW(find_constraint(with.graph, id), Error);
  EXPECT_THROW(erase_constraint(with.graph, id), Error);
  EXPECT_THROW(set_pinned(with.graph, id, true), Error);
  EXPECT_THROW(explain(with.graph, id), Error);
}

/// Three sessions over the same block, each in an odometry frame of its own.
World sessions(unsigned seed, std::uint32_t false_groups, std::uint32_t true_loops) {
  std::mt19937 rng(seed);
  World world;
  world.drive(0, 0, 30, truth(0), rng);
  for (const std::uint32_t first : {100u, 200u}) {
    const Tangent anywhere = (Tangent() << 300, -200, 5, 0.02, -0.03, 2.5).finished();
    world.drive(first, first / 10, 30, exp(Tangent(anywhere * (first / 100.0))), rng);
  }
  for (std::uint32_t i = 0; i < true_loops; ++i) {
    world.true_loop(10 + 19 * i / true_loops, 100 + 19 * i / true_loops, rng);
    world.true_loop(110 + 19 * i / true_loops, 200 + 19 * i / true_loops, rng);
  }
  for (std::uint32_t i = 0; i < false_groups; ++i) {
    world.false_loops(rng() % 10, 115 + rng() % 10, 2, rng);
    world.false_loops(100 + rng() % 10, 215 + rng() % 10, 2, rng);
  }
  return world;
}

TEST(Sessions, AreJoinedByTheLoopsThatAgreeHoweverManyDoNot) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    World clean = sessions(seed, 0, 6), world = sessions(seed, 6, 6);  // two thirds are false
    EXPECT_GT(world.error_m(), 50);
    ASSERT_TRUE(optimize(clean.graph).converged);
    ASSERT_TRUE(optimize(world.graph).converged);
    EXPECT_LT(clean.error_m(), 1.5) << seed;
    EXPECT_LT(world.error_m(), 1.05 * clean.error_m()) << seed;
    EXPECT_EQ(world.misjudged(), 0u) << seed;
  }
}

TEST(Sessions, StayWhereTheyAreWithoutEnoughLoopsThatAgree) {
  std::mt19937 rng(3);
  World world = sessions(1, 0, 0);
  for (const auto& [from, to] : {std::pair{2u, 120u}, {20u, 104u}, {103u, 225u}}) {
    world.false_loops(from, to, 1, rng);
  }
  const auto before = world.graph.nodes;
  for (const auto& [id, T] : chain_start(world.graph, 2, 4)) {
    EXPECT_EQ(T.matrix(), before.at(id).matrix());
  }
}

TEST(Sessions, OneLoopJoinsTwoByDefault) {
  std::mt19937 rng(3);
  World world = sessions(1, 0, 0);
  world.true_loop(12, 102, rng);
  world.true_loop(112, 202, rng);
  ASSERT_TRUE(optimize(world.graph).converged);
  EXPECT_LT(world.error_m(), 1.5);
  EXPECT_EQ(world.misjudged(), 0u);
}

TEST(ConsistentLoops, AreTheTrueOnesAmongMoreFalseOnes) {
  for (unsigned seed = 1; seed <= 10; ++seed) {
    const World world = sessions(seed, 6, 6);
    std::vector<std::size_t> between;
    for (std::size_t i = 0; i < world.graph.constraints.size(); ++i) {
      const Constraint& c = world.graph.constraints[i];
      if (c.from.value < 100 && c.to.value >= 100) between.push_back(i);
    }
    ASSERT_EQ(between.size(), 18u);
    const auto found = consistent_loops(world.graph, between, 4);
    EXPECT_GE(found.size(), 5u);
    for (const std::size_t k : found) EXPECT_TRUE(world.is_true[between[k]]) << seed;
  }
}

/// Two exact sessions and a loop measured from either side: the motion is known in closed form.
TEST(ChainStart, MovesASessionAsARigidBodyToWhereItsLoopSays) {
  for (const bool from_first : {true, false}) {
    std::mt19937 rng(9);
    World world = sessions(2, 0, 0);
    std::erase_if(world.graph.nodes, [](const auto& node) { return node.first.value >= 200; });
    std::erase_if(world.graph.constraints, [](const Constraint& c) { return c.to.value >= 200; });
    Constraint loop = world.graph.constraints.back();
    loop.kind = ConstraintKind::kLoop;
    loop.from = {from_first ? 12u : 102u};
    loop.to = {from_first ? 102u : 12u};
    loop.T_from_to = world.between(loop.from.value, loop.to.value);
    world.graph.constraints.push_back(loop);
    const auto found = chain_start(world.graph, 1, 4);
    const Pose T = found.at(loop.from).inverse() * found.at(loop.to);
    EXPECT_LT(log(T.inverse() * loop.T_from_to).norm(), 1e-9);
    for (std::uint32_t i = 100; i < 129; ++i) {
      const auto& given = world.graph.nodes;
      const Pose before = given.at({i}).inverse() * given.at({i + 1});
      const Pose after = found.at({i}).inverse() * found.at({i + 1});
      EXPECT_LT((before.matrix() - after.matrix()).norm(), 1e-9);
      EXPECT_EQ(found.at({i - 100}).matrix(), given.at({i - 100}).matrix());
    }
  }
}

}  // namespace
}  // namespace cellmap
