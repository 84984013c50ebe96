#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "cellmap/pose_graph/pose_graph.hpp"
#include "support/ceres_pose_graph.hpp"

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

/// Three rounds of a hilly block, 6 m a step, with the drift of the odometry in the nodes. Every
/// fourth node of the later rounds closes a loop to the round before; some closures are false.
PoseGraph drive(std::uint32_t nodes_a_round, int false_loops) {
  std::mt19937 rng(4);
  std::vector<Pose> truth;
  PoseGraph graph;
  for (std::uint32_t i = 0; i < 3 * nodes_a_round; ++i) {
    const double angle = 2 * M_PI * i / nodes_a_round, radius = nodes_a_round;
    Pose T = Pose::Identity();
    T.translation() << radius * std::cos(angle), radius * std::sin(angle), 3 * std::sin(2 * angle);
    T.rotate(Eigen::AngleAxisd(angle + M_PI / 2, Eigen::Vector3d::UnitZ()));
    truth.push_back(T);
    if (i == 0) {
      graph.nodes[{0}] = T;
      continue;
    }
    graph.constraints.push_back(
        measured(i - 1, i, truth[i - 1].inverse() * T, rng, ConstraintKind::kBidirectional));
    graph.nodes[{i}] = graph.nodes.at({i - 1}) * graph.constraints.back().T_from_to;
  }
  for (std::uint32_t i = nodes_a_round; i < truth.size(); i += 4) {
    const std::uint32_t earlier = i - nodes_a_round;
    graph.constraints.push_back(
        measured(earlier, i, truth[earlier].inverse() * truth[i], rng, ConstraintKind::kLoop));
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

TEST_P(OptimizeTwin, FindsThePosesThatCeresFinds) {
  const PoseGraph start = drive(40, GetParam().false_loops);
  CeresPoseGraph ceres(start, GetParam().loss_scale);
  const ceres::Solver::Summary theirs = ceres.solve(2000, 1e-15);
  PoseGraph graph = start;
  PoseGraphOptions options;
  options.loop_loss_scale = GetParam().loss_scale;

  const PoseGraphSummary ours = optimize(graph, options);

  ASSERT_TRUE(ours.converged);
  EXPECT_NEAR(ours.initial_cost, theirs.initial_cost, 1e-9 * theirs.initial_cost);
  EXPECT_NEAR(ours.final_cost, theirs.final_cost, 1e-7 * theirs.final_cost);
  for (const auto& [id, T] : graph.nodes) {
    // Nodes that would move by less than 0.1 mm and 1e-6 rad stay.
    EXPECT_LT((T.translation() - ceres.pose(id).translation()).norm(), 1.5e-4) << id.value;
    EXPECT_LT(angle_between_rad(T, ceres.pose(id)), 2e-6) << id.value;
  }
}

INSTANTIATE_TEST_SUITE_P(, OptimizeTwin,
                         testing::Values(Twin{"LeastSquares", 0, 0}, Twin{"RobustLoss", 0, 1},
                                         Twin{"RobustLossAndFalseLoops", 3, 1}),
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
