#include "cellmap/pose_graph/pose_graph.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <random>

#include "cellmap/core/error.hpp"
#include "support/dense_pose_graph.hpp"

namespace cellmap {
namespace {

Tangent random_step(std::mt19937& rng, double translation, double rotation) {
  std::normal_distribution<double> normal;
  Tangent xi;
  for (int i = 0; i < 6; ++i) xi[i] = normal(rng) * (i < 3 ? translation : rotation);
  return xi;
}

Matrix6d random_information(std::mt19937& rng) {
  std::normal_distribution<double> normal;
  Matrix6d A;
  for (double& value : A.reshaped()) value = normal(rng);
  return A * A.transpose() + 0.1 * Matrix6d::Identity();
}

Constraint tie(std::uint32_t from, std::uint32_t to, const Pose& T_from_to, double sigma = 0.05) {
  Constraint constraint;
  constraint.from = {from};
  constraint.to = {to};
  constraint.T_from_to = T_from_to;
  constraint.information = Matrix6d::Identity() / (sigma * sigma);
  return constraint;
}

/// What the header promises, written with angles and axes, independent of the solver.
double cost_by_definition(const PoseGraph& graph) {
  double cost = 0;
  for (const Constraint& c : graph.constraints) {
    const Pose T = graph.nodes.at(c.from).inverse() * graph.nodes.at(c.to);
    const Tangent xi = left_error(T, c.T_from_to);
    cost += 0.5 * xi.dot(c.information * xi);
  }
  return cost;
}

PoseGraph random_graph(std::mt19937& rng, std::uint32_t nodes, std::uint32_t extra_ties) {
  PoseGraph graph;
  Pose T = exp(random_step(rng, 1, 0.5));
  for (std::uint32_t i = 0; i < nodes; ++i) {
    graph.nodes[{i + 10}] = T;
    const Pose step = exp(random_step(rng, 2, 0.5));
    T = T * step;
    if (i + 1 < nodes) {
      graph.constraints.push_back(tie(i + 10, i + 11, step * exp(random_step(rng, 0.05, 0.02))));
    }
  }
  std::uniform_int_distribution<std::uint32_t> pick(10, nodes + 9);
  while (extra_ties > 0) {
    const std::uint32_t a = pick(rng), b = pick(rng);
    if (a == b) continue;
    const Pose measured = graph.nodes[{a}].inverse() * graph.nodes[{b}];
    graph.constraints.push_back(tie(a, b, measured * exp(random_step(rng, 0.05, 0.02))));
    --extra_ties;
  }
  for (Constraint& c : graph.constraints) c.information = random_information(rng);
  return graph;
}

TEST(PoseGraph, TheCostIsTheOneOfTheLeftPerturbation) {
  std::mt19937 rng(1);
  for (int i = 0; i < 5; ++i) {
    PoseGraph graph = random_graph(rng, 8, 6);
    const double before = cost_by_definition(graph);
    const PoseGraphSummary summary = optimize(graph);
    EXPECT_NEAR(summary.initial_cost, before, 1e-9 * before);
    // Nodes that moved by less than 0.1 mm stay, so the graph's cost is only nearly the solver's.
    EXPECT_NEAR(summary.final_cost, cost_by_definition(graph), 1e-4 * before);
    EXPECT_LT(summary.final_cost, 0.9 * before);
  }
}

TEST(PoseGraph, TheOptimumHasNoSlopeInAnyDirection) {
  std::mt19937 rng(2);
  PoseGraph graph = random_graph(rng, 6, 5);
  const double before = cost_by_definition(graph);
  optimize(graph);
  const double at_optimum = cost_by_definition(graph);
  for (auto& [id, T] : graph.nodes) {
    if (id == CellId{10}) continue;
    const Pose kept = T;
    for (int axis = 0; axis < 6; ++axis) {
      for (const double step : {-1e-3, 1e-3}) {
        T = kept * exp(Tangent::Unit(axis) * step);
        EXPECT_GT(cost_by_definition(graph), at_optimum - 1e-7 * before);
      }
    }
    T = kept;
  }
}

TEST(PoseGraph, TheLowestNodeOfEveryComponentKeepsItsPoseToTheBit) {
  std::mt19937 rng(3);
  PoseGraph graph = random_graph(rng, 6, 6);
  const PoseGraph other = random_graph(rng, 5, 4);
  for (const auto& [id, T] : other.nodes) graph.nodes[{id.value + 100}] = T;
  for (Constraint c : other.constraints) {
    c.from.value += 100;
    c.to.value += 100;
    graph.constraints.push_back(c);
  }
  graph.nodes[{500}] = exp(random_step(rng, 1, 1));  // tied to nothing
  const auto before = graph.nodes;

  const PoseGraphSummary summary = optimize(graph);

  for (const std::uint32_t id : {10u, 110u, 500u}) {
    EXPECT_EQ(before.at({id}).matrix(), graph.nodes.at({id}).matrix());
  }
  EXPECT_EQ(summary.moved, 5u + 4u);
}

TEST(PoseGraph, ThePosesDoNotDependOnTheThreadCount) {
  std::mt19937 rng(4);
  PoseGraph one = random_graph(rng, 40, 40);
  PoseGraph two = one;
  optimize(one);
  PoseGraphOptions options;
  options.threads = 2;
  optimize(two, options);
  for (const auto& [id, T] : one.nodes) EXPECT_EQ(T.matrix(), two.nodes.at(id).matrix());
}

TEST(PoseGraph, OneThreadIsOneThread) {
  const auto threads = [] {
    const std::filesystem::directory_iterator tasks("/proc/self/task");
    return std::distance(begin(tasks), end(tasks));
  };
  std::mt19937 rng(5);
  PoseGraph graph = random_graph(rng, 300, 600);  // blocks large enough for CHOLMOD's own threads
  const auto before = threads();
  optimize(graph);
  EXPECT_EQ(threads(), before) << "a library underneath has started some of its own";
}

TEST(PoseGraph, AnOptimisedGraphDoesNotMoveAgain) {
  std::mt19937 rng(5);
  PoseGraph graph = random_graph(rng, 10, 10);
  optimize(graph);
  const auto before = graph.nodes;
  EXPECT_EQ(optimize(graph).moved, 0u);
  for (const auto& [id, T] : before) EXPECT_EQ(T.matrix(), graph.nodes.at(id).matrix());
}

/// A square drive of `side_m` with a yaw drift at each step; the last node is back at the first.
PoseGraph drifting_square(double drift_rad) {
  constexpr int kStepsASide = 10;
  PoseGraph graph;
  Pose T = Pose::Identity();
  for (std::uint32_t i = 0; i <= 4 * kStepsASide; ++i) {
    graph.nodes[{i}] = T;
    Pose step = Pose::Identity();
    step.translation().x() = 6;
    if (i % kStepsASide == kStepsASide - 1)
      step.rotate(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ()));
    step.rotate(Eigen::AngleAxisd(drift_rad, Eigen::Vector3d::UnitZ()));
    if (i < 4 * kStepsASide) graph.constraints.push_back(tie(i, i + 1, step));
    T = T * step;
  }
  return graph;
}

TEST(PoseGraph, ALoopClosesADriftingDrive) {
  PoseGraph graph = drifting_square(0.005);
  const double gap_before = graph.nodes[{40}].translation().norm();
  graph.constraints.push_back(tie(0, 40, Pose::Identity()));
  graph.constraints.back().kind = ConstraintKind::kLoop;
  optimize(graph);
  EXPECT_GT(gap_before, 5.0);
  EXPECT_LT(graph.nodes[{40}].translation().norm(), 0.1);
  EXPECT_NEAR(graph.nodes[{20}].translation().x(), 60, 1.0);
  EXPECT_NEAR(graph.nodes[{20}].translation().y(), 60, 1.0);
}

TEST(PoseGraph, AFalseLoopBendsTheMapFarLessWithTheRobustLoss) {
  const auto worst_error = [](double loss_scale) {
    PoseGraph graph = drifting_square(0);
    const auto truth = graph.nodes;
    graph.constraints.push_back(tie(0, 40, Pose::Identity()));  // true
    graph.constraints.push_back(tie(5, 25, Pose::Identity()));  // false: opposite sides
    for (std::size_t i = 40; i < 42; ++i) graph.constraints[i].kind = ConstraintKind::kLoop;
    PoseGraphOptions options;
    options.loop_loss_scale = loss_scale;
    optimize(graph, options);
    double worst = 0;
    for (const auto& [id, T] : truth) {
      worst = std::max(worst, (graph.nodes[id].translation() - T.translation()).norm());
    }
    return worst;
  };
  EXPECT_GT(worst_error(0), 5.0);
  EXPECT_LT(worst_error(PoseGraphOptions{}.loop_loss_scale), 0.2);
}

TEST(PoseGraph, WhatIsNoConstraintIsRefused) {
  const Constraint good = tie(1, 2, Pose::Identity());
  EXPECT_NO_THROW(validate(good));
  Constraint to_itself = good;
  to_itself.to = to_itself.from;
  EXPECT_THROW(validate(to_itself), Error);
  Constraint scaled = good;
  scaled.T_from_to.linear() *= 1.1;
  EXPECT_THROW(validate(scaled), Error);
  for (const double value :
       {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), -1.0}) {
    Constraint bad = good;
    bad.information(2, 2) = value;
    EXPECT_THROW(validate(bad), Error) << value;
  }
  Constraint lopsided = good;
  lopsided.information(0, 1) = 5;
  EXPECT_THROW(validate(lopsided), Error);
  Constraint weightless = good;
  weightless.information.setZero();
  EXPECT_THROW(validate(weightless), Error);
}

TEST(PoseGraph, AConstraintToAnUnknownCellIsRefused) {
  PoseGraph graph = drifting_square(0);
  graph.constraints.push_back(tie(3, 99, Pose::Identity()));
  EXPECT_THROW(optimize(graph), Error);
}

TEST(PoseGraph, AGraphWithoutConstraintsIsLeftAlone) {
  PoseGraph graph;
  EXPECT_TRUE(optimize(graph).converged);
  graph.nodes[{1}] = Pose::Identity();
  EXPECT_TRUE(optimize(graph).converged);
  EXPECT_EQ(graph.nodes.size(), 1u);
}

}  // namespace
}  // namespace cellmap
