#include "cellmap/place/loop_detection.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <memory>
#include <vector>

#include "support/expect_error.hpp"
#include "support/registration_world.hpp"

namespace cellmap {
namespace {

/// `count` CELLs 6 m apart along x, tied as neighbours.
PoseGraph straight_session(std::uint32_t count) {
  PoseGraph graph;
  for (std::uint32_t i = 1; i <= count; ++i) {
    Pose T = Pose::Identity();
    T.translation().x() = 6.0 * i;
    graph.nodes[{i}] = T;
    if (i == 1) continue;
    Constraint c;
    c.from = {i - 1};
    c.to = {i};
    c.T_from_to.translation().x() = 6;
    graph.constraints.push_back(c);
  }
  return graph;
}

TEST(LoopCandidates, AreTheNearestFirstWithoutTheLatestOfTheSession) {
  const PoseGraph graph = straight_session(30);
  LoopOptions options;
  options.exclude_latest = 3;
  options.candidates = 4;
  const auto found = find_loop_candidates(graph, {30}, options);
  ASSERT_EQ(found.size(), 2u);  // 24 m and 30 m away; the next is beyond max_distance_m
  EXPECT_EQ(found[0].cell, CellId{26});
  EXPECT_EQ(found[1].cell, CellId{25});
  EXPECT_NEAR(found[0].distance_m, 24, 1e-9);
  EXPECT_NEAR(found[0].path_m, 24, 1e-9);
  EXPECT_NEAR(found[0].T_candidate_query.translation().x(), 24, 1e-9);
}

TEST(LoopCandidates, OfAnotherSessionMayBeAnyAndTheirPathIsInfinite) {
  PoseGraph graph = straight_session(20);
  graph.nodes[{50}] = graph.nodes[{10}];
  const auto found = find_loop_candidates(graph, {50}, {});
  ASSERT_EQ(found.size(), 10u);
  EXPECT_EQ(found[0].cell, CellId{10});
  EXPECT_TRUE(std::isinf(found[0].path_m));
}

TEST(LoopCandidates, ALoopShortensThePath) {
  PoseGraph graph = straight_session(40);
  graph.nodes[{40}] = graph.nodes[{1}];
  EXPECT_NEAR(find_loop_candidates(graph, {40}, {}).front().path_m, 39 * 6, 1e-9);
  Constraint loop;
  loop.from = {2};
  loop.to = {39};
  loop.kind = ConstraintKind::kLoop;
  graph.constraints.push_back(loop);
  EXPECT_NEAR(find_loop_candidates(graph, {40}, {}).front().path_m, 12, 1e-9);
}

TEST(LoopCandidates, OfAnUnknownCellAreRefused) {
  test::expect_error(
      ErrorCode::kNotFound, [] { find_loop_candidates({}, {3}, {}); }, "CELL 3");
}

/// A loop from the street to another scene, both seen from the same pose.
std::optional<LoopClosure> close_loop(const test::BoxScene& query_scene, LoopAcceptance accept) {
  const Pose at = Pose::Identity();
  const RegistrationTarget candidate = test::target_at(test::street(), at);
  const RegistrationTarget query = test::target_at(query_scene, at);
  LoopOptions options;
  options.accept = accept;
  return verify_loop(candidate, query, query_scene.scan(at), {.cell = {1}}, {2}, options);
}

TEST(LoopVerification, TheSamePlaceClosesByEitherAcceptance) {
  for (const auto accept : {LoopAcceptance::kScores, LoopAcceptance::kPaper}) {
    const auto closure = close_loop(test::street(), accept);
    ASSERT_TRUE(closure.has_value());
    EXPECT_LT(closure->result.T_target_source.translation().norm(), 0.02);
  }
}

/// Most points still lie on planes of the CELL, which is all that the paper's ratio asks; a wall
/// where the CELL saw free road is what the other scores see.
TEST(LoopVerification, AWallAcrossTheRoadIsRefusedExceptByThePapersRatio) {
  test::BoxScene walled = test::street();
  walled.add({6.0, -3.0, -1.7}, {6.5, 4.5, 3.0});
  EXPECT_TRUE(close_loop(walled, LoopAcceptance::kPaper).has_value());
  EXPECT_FALSE(close_loop(walled, LoopAcceptance::kScores).has_value());
}

/// Closures of a CELL that sees a wall across the road, where four others of another session stand;
/// the nearest does not see the wall.
std::vector<CellId> closed_loops(std::size_t closures) {
  test::BoxScene walled = test::street();
  walled.add({6.0, -3.0, -1.7}, {6.5, 4.5, 3.0});
  PoseGraph graph;
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> targets;
  const auto add = [&](std::uint32_t id, const test::BoxScene& scene, double x) {
    const CellId cell{id};
    graph.nodes[cell] = Pose(Eigen::Translation3d(x, 0, 0));
    targets[cell] =
        std::make_shared<const RegistrationTarget>(test::target_at(scene, graph.nodes[cell]));
  };
  add(1, test::street(), 0.0);
  add(2, walled, 0.3);
  add(3, walled, 0.6);
  add(4, walled, 0.9);
  add(9, walled, 0.0);
  Constraint tie;  // so that the guesses are certain
  tie.to = {9};
  tie.kind = ConstraintKind::kLoop;
  for (std::uint32_t id = 1; id <= 4; ++id) {
    tie.from = {id};
    tie.T_from_to = graph.nodes[tie.from].inverse() * graph.nodes[tie.to];
    graph.constraints.push_back(tie);
  }
  LoopOptions options;
  options.closures = closures;
  std::vector<CellId> closed;
  for (const LoopClosure& closure : detect_loops(
           graph, {9}, walled.scan(graph.nodes[{9}]), [&](CellId id) { return targets.at(id); },
           options)) {
    closed.push_back(closure.from);
  }
  return closed;
}

TEST(LoopDetection, GoesOnToFartherCellsUntilEnoughHaveClosed) {
  EXPECT_EQ(closed_loops(1), (std::vector<CellId>{{2}}));
  EXPECT_EQ(closed_loops(2), (std::vector<CellId>{{2}, {3}}));
  EXPECT_EQ(closed_loops(10), (std::vector<CellId>{{2}, {3}, {4}}));
}

TEST(LoopConstraint, IsNotTrustedBeyondWhatRegistrationKnows) {
  LoopClosure closure{{1}, {2}, {}};
  closure.result.information = 1e12 * Matrix6d::Identity();
  const Constraint c = to_constraint(closure, ConstraintOrigin::kDetection);
  validate(c);
  EXPECT_EQ(c.kind, ConstraintKind::kLoop);
  const Matrix6d covariance = c.information.inverse();
  for (int i = 0; i < 3; ++i) EXPECT_GT(std::sqrt(covariance(i, i)), 0.02);
  // What was not measured stays without weight.
  closure.result.information.setZero();
  closure.result.information(0, 0) = 1e12;
  const Constraint weak = to_constraint(closure, ConstraintOrigin::kDetection);
  EXPECT_GT(weak.information(0, 0), 100);
  EXPECT_NEAR(weak.information(1, 1), 0, 1e-6);
}

}  // namespace
}  // namespace cellmap
