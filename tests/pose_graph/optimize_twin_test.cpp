#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "cellmap/pose_graph/pose_graph.hpp"
#include "support/dense_pose_graph.hpp"

namespace cellmap {
namespace {

constexpr double kSigmaM = 0.05, kSigmaRad = 0.002;

Tangent noise(std::mt19937& rng) {
  std::normal_distribution<double> normal;
  Tangent xi;
  for (int i = 0; i < 6; ++i) xi[i] = normal(rng) * (i < 3 ? kSigmaM : kSigmaRad);
  return xi;
}

Constraint measured(std::uint32_t from, std::uint32_t to, const Pose& T_from_to, std::mt19937& rng,
                    ConstraintKind kind) {
  Constraint constraint;
  constraint.from = {from};
  constraint.to = {to};
  constraint.T_from_to = exp(noise(rng)) * T_from_to;
  constraint.kind = kind;
  constraint.information.diagonal().head<3>().setConstant(1 / (kSigmaM * kSigmaM));
  constraint.information.diagonal().tail<3>().setConstant(1 / (kSigmaRad * kSigmaRad));
  return constraint;
}

/// Three rounds of a hilly block.
Pose truth(std::uint32_t nodes_a_round, std::uint32_t i) {
  const double angle = 2 * M_PI * i / nodes_a_round, radius = nodes_a_round;
  Pose T = Pose::Identity();
  T.translation() << radius * std::cos(angle), radius * std::sin(angle), 3 * std::sin(2 * angle);
  T.rotate(Eigen::AngleAxisd(angle + M_PI / 2, Eigen::Vector3d::UnitZ()));
  return T;
}

/// That drive, 6 m a step, with the drift of the odometry in the nodes. Every fourth node of the
/// later rounds closes a loop to the round before; some closures are false.
PoseGraph drive(std::uint32_t nodes_a_round, int false_loops, unsigned seed = 4) {
  std::mt19937 rng(seed);
  PoseGraph graph;
  graph.nodes[{0}] = truth(nodes_a_round, 0);
  const auto tie = [&](std::uint32_t from, std::uint32_t to, ConstraintKind kind) {
    const Pose T_from_to = truth(nodes_a_round, from).inverse() * truth(nodes_a_round, to);
    graph.constraints.push_back(measured(from, to, T_from_to, rng, kind));
  };
  for (std::uint32_t i = 1; i < 3 * nodes_a_round; ++i) {
    tie(i - 1, i, ConstraintKind::kBidirectional);
    graph.nodes[{i}] = graph.nodes.at({i - 1}) * graph.constraints.back().T_from_to;
  }
  for (std::uint32_t i = nodes_a_round; i < 3 * nodes_a_round; i += 4) {
    tie(i - nodes_a_round, i, ConstraintKind::kLoop);
  }
  for (int i = 0; i < false_loops; ++i) {
    const auto from = static_cast<std::uint32_t>(7 * i), to = from + nodes_a_round / 2;
    graph.constraints.push_back(measured(from, to, Pose::Identity(), rng, ConstraintKind::kLoop));
  }
  return graph;
}

struct Twin {
  const char* name;
  int false_loops;
  double loss_scale;
};

class OptimizeTwin : public testing::TestWithParam<Twin> {};

/// The twin starts from the truth, so ours must end in the right one of the minima that false loops
/// make.
TEST_P(OptimizeTwin, FindsThePosesThatADenseSolverFindsFromTheTruth) {
  const auto [name, false_loops, loss_scale] = GetParam();
  PoseGraph graph = drive(40, false_loops);
  EXPECT_GT((graph.nodes.at({119}).translation() - truth(40, 119).translation()).norm(), 1);
  PoseGraphOptions options;
  options.loop_loss_scale = loss_scale;
  const double cost_before = DensePoseGraph(graph, loss_scale).cost();

  const PoseGraphSummary summary = optimize(graph, options);

  PoseGraph start = graph;
  for (auto& [id, T] : start.nodes) T = truth(40, id.value);
  DensePoseGraph twin(start, loss_scale);
  ASSERT_TRUE(twin.solve());
  ASSERT_TRUE(summary.converged);
  EXPECT_NEAR(summary.initial_cost, cost_before, 1e-9 * cost_before);
  EXPECT_NEAR(summary.final_cost, twin.cost(), 1e-7 * twin.cost());
  for (const auto& [id, T] : graph.nodes) {
    const Pose& T_twin = twin.graph().nodes.at(id);
    // Nodes that would move by less than 0.1 mm and 1e-6 rad stay.
    EXPECT_LT((T.translation() - T_twin.translation()).norm(), 1.5e-4) << id.value;
    EXPECT_LT(angle_between_rad(T, T_twin), 2e-6) << id.value;
  }
}

INSTANTIATE_TEST_SUITE_P(, OptimizeTwin,
                         testing::Values(Twin{"LeastSquares", 0, 0}, Twin{"RobustLoss", 0, 4},
                                         Twin{"RobustLossAndFalseLoops", 3, 4}),
                         [](const auto& info) { return info.param.name; });

TEST(Optimize, OneNewLoopTakesAFewStepsFromTheLastSolution) {
  PoseGraph graph = drive(40, 0);
  const Constraint last = graph.constraints.back();
  graph.constraints.pop_back();
  ASSERT_TRUE(optimize(graph).converged);
  graph.constraints.push_back(last);
  const PoseGraphSummary summary = optimize(graph);
  EXPECT_TRUE(summary.converged);
  EXPECT_LE(summary.iterations, 12);
}

/// The gap of the loop is many of its own sigmas wide, but what the drift of the odometry may be.
TEST(Optimize, ATrueFirstLoopAfterALongDriftCloses) {
  int closed = 0;
  for (unsigned seed = 1; seed <= 20; ++seed) {
    PoseGraph graph = drive(100, 0, seed);
    std::erase_if(graph.constraints, [](const Constraint& c) {
      return c.kind == ConstraintKind::kLoop && c.to.value != 296;
    });
    const Constraint& loop = graph.constraints.back();
    const auto gap_m = [&] {
      const Pose T = graph.nodes.at(loop.from).inverse() * graph.nodes.at(loop.to);
      return (T.translation() - loop.T_from_to.translation()).norm();
    };
    EXPECT_GT(gap_m(), 20 * kSigmaM);
    ASSERT_TRUE(optimize(graph).converged);
    if (gap_m() < 3 * kSigmaM) ++closed;
  }
  EXPECT_GE(closed, 19);
}

TEST(Optimize, WhatNoLoopSpansFollowsRigidly) {
  PoseGraph graph = drive(40, 0);
  std::erase_if(graph.constraints, [](const Constraint& c) {
    return c.kind == ConstraintKind::kLoop && c.to.value > 60;
  });
  const PoseGraph before = graph;
  optimize(graph);
  for (std::uint32_t i = 70; i + 1 < graph.nodes.size(); ++i) {
    const Pose T_before = before.nodes.at({i}).inverse() * before.nodes.at({i + 1});
    const Pose T_after = graph.nodes.at({i}).inverse() * graph.nodes.at({i + 1});
    EXPECT_LT(log(T_before.inverse() * T_after).norm(), 1e-9) << i;
  }
}

}  // namespace
}  // namespace cellmap
