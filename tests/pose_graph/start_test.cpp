#include "cellmap/pose_graph/start.hpp"

#include <gtest/gtest.h>

#include <random>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

Pose random_pose(std::mt19937& rng, double translation, double rotation) {
  std::normal_distribution<double> normal;
  Tangent xi;
  for (int i = 0; i < 6; ++i) xi[i] = normal(rng) * (i < 3 ? translation : rotation);
  return exp(xi);
}

Constraint tie(std::uint32_t from, std::uint32_t to, const Pose& T_from_to, ConstraintKind kind) {
  Constraint constraint;
  constraint.from = {from};
  constraint.to = {to};
  constraint.T_from_to = T_from_to;
  constraint.kind = kind;
  constraint.information *= 100;
  return constraint;
}

/// A random walk of `count` nodes from `first` with exact neighbours and exact loops of every
/// length, its nodes at the truth.
PoseGraph exact_walk(std::mt19937& rng, std::uint32_t first, std::uint32_t count) {
  PoseGraph graph;
  Pose T = random_pose(rng, 10, 1);
  for (std::uint32_t i = first; i < first + count; ++i) {
    graph.nodes[{i}] = T;
    T = T * random_pose(rng, 2, 0.6);
  }
  const auto add = [&](std::uint32_t a, std::uint32_t b, ConstraintKind kind) {
    const Pose T_a_b = graph.nodes.at({a}).inverse() * graph.nodes.at({b});
    graph.constraints.push_back(tie(a, b, T_a_b, kind));
  };
  for (std::uint32_t i = first; i + 1 < first + count; ++i)
    add(i, i + 1, ConstraintKind::kOdometry);
  for (std::uint32_t i = first; i + 7 < first + count; i += 3) add(i + 7, i, ConstraintKind::kLoop);
  return graph;
}

void scatter(PoseGraph& graph, std::mt19937& rng, const std::vector<std::uint32_t>& fixed) {
  for (auto& [id, T] : graph.nodes) {
    const bool stays = std::find(fixed.begin(), fixed.end(), id.value) != fixed.end();
    if (!stays) T = random_pose(rng, 20, 2);
  }
}

void expect_same(const std::map<CellId, Pose>& found, const std::map<CellId, Pose>& expected,
                 double tolerance) {
  ASSERT_EQ(found.size(), expected.size());
  for (const auto& [id, T] : expected) {
    EXPECT_LT((found.at(id).matrix() - T.matrix()).norm(), tolerance) << id.value;
  }
}

class Start : public testing::TestWithParam<std::map<CellId, Pose> (*)(const PoseGraph&)> {};

TEST_P(Start, FindsTheTruthOfExactConstraintsWhereverTheNodesWere) {
  std::mt19937 rng(1);
  PoseGraph graph = exact_walk(rng, 3, 60);
  const auto truth = graph.nodes;
  scatter(graph, rng, {3});
  expect_same(GetParam()(graph), truth, 1e-9);
}

TEST_P(Start, EveryComponentHangsOnItsLowestNode) {
  std::mt19937 rng(2);
  PoseGraph graph = exact_walk(rng, 0, 20);
  const PoseGraph other = exact_walk(rng, 50, 20);
  graph.nodes.insert(other.nodes.begin(), other.nodes.end());
  graph.nodes[{99}] = random_pose(rng, 5, 1);  // tied to nothing
  graph.constraints.insert(graph.constraints.end(), other.constraints.begin(),
                           other.constraints.end());
  const auto truth = graph.nodes;
  scatter(graph, rng, {0, 50, 99});
  const auto found = GetParam()(graph);
  expect_same(found, truth, 1e-9);
  for (const std::uint32_t id : {0u, 50u, 99u}) {
    EXPECT_EQ(found.at({id}).matrix(), truth.at({id}).matrix());
  }
}

TEST_P(Start, ARejectedLoopDoesNotCount) {
  std::mt19937 rng(3);
  PoseGraph graph = exact_walk(rng, 0, 30);
  const auto truth = graph.nodes;
  graph.constraints.push_back(tie(2, 25, Pose::Identity(), ConstraintKind::kLoop));
  graph.constraints.back().weight = 0;
  scatter(graph, rng, {0});
  expect_same(GetParam()(graph), truth, 1e-9);
}

TEST_P(Start, AConstraintToAnUnknownCellIsRefused) {
  PoseGraph graph;
  graph.nodes[{1}] = Pose::Identity();
  graph.constraints.push_back(tie(1, 2, Pose::Identity(), ConstraintKind::kLoop));
  EXPECT_THROW(GetParam()(graph), Error);
}

INSTANTIATE_TEST_SUITE_P(, Start, testing::Values(&spanning_tree_start, &chordal_start),
                         [](const auto& info) { return info.index == 0 ? "Tree" : "Chordal"; });

TEST(SpanningTreeStart, FollowsTheNeighboursEvenWhereALoopDisagrees) {
  std::mt19937 rng(4);
  PoseGraph graph = exact_walk(rng, 0, 40);
  const auto truth = graph.nodes;
  for (Constraint& c : graph.constraints) {
    if (c.kind == ConstraintKind::kLoop) c.T_from_to = random_pose(rng, 5, 1);
  }
  expect_same(spanning_tree_start(graph), truth, 1e-9);
}

/// Noise of 0.05 rad a step over 400 steps turns a chain anywhere; the chordal start stays near.
TEST(ChordalStart, IsNearTheTruthWhereTheOdometryIsLost) {
  std::mt19937 rng(5);
  PoseGraph graph = exact_walk(rng, 0, 400);
  const auto truth = graph.nodes;
  for (std::uint32_t i = 0; i + 31 < 400; ++i) {
    const Pose T = truth.at({i}).inverse() * truth.at({i + 31});
    graph.constraints.push_back(tie(i, i + 31, T, ConstraintKind::kLoop));
  }
  for (Constraint& c : graph.constraints) c.T_from_to = c.T_from_to * random_pose(rng, 0.05, 0.05);
  const auto rms = [&](const std::map<CellId, Pose>& poses) {
    double sum = 0;
    for (const auto& [id, T] : poses) {
      sum += (T.translation() - truth.at(id).translation()).squaredNorm();
    }
    return std::sqrt(sum / 400);
  };
  const double tree = rms(spanning_tree_start(graph)), chordal = rms(chordal_start(graph));
  EXPECT_LT(chordal, 0.25 * tree);
}

}  // namespace
}  // namespace cellmap
