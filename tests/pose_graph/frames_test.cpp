#include "cellmap/pose_graph/frames.hpp"

#include <gmock/gmock.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

PoseGraph graph_of(std::initializer_list<std::uint32_t> cells,
                   std::initializer_list<std::pair<std::uint32_t, std::uint32_t>> ties) {
  PoseGraph graph;
  for (const auto cell : cells) graph.nodes[{cell}] = Pose::Identity();
  for (const auto& [from, to] : ties) {
    Constraint constraint;
    constraint.from = {from};
    constraint.to = {to};
    graph.constraints.push_back(constraint);
  }
  return graph;
}

TEST(Frames, AreNamedByTheLowestIdWhateverTheOrderOfTheConstraints) {
  const Frames islands(graph_of({2, 3, 5, 7, 8, 9}, {{9, 8}, {7, 3}, {8, 7}, {2, 5}}));
  EXPECT_EQ(islands.count(), 2u);
  for (const auto cell : {3u, 7u, 8u, 9u}) EXPECT_EQ(islands.of({cell}), CellId{3});
  for (const auto cell : {2u, 5u}) EXPECT_EQ(islands.of({cell}), CellId{2});
}

TEST(Frames, TheMapFrameIsThatOfTheLowestId) {
  const Frames islands(graph_of({4, 5, 6}, {{4, 6}}));
  EXPECT_TRUE(islands.is_aligned({4}));
  EXPECT_TRUE(islands.is_aligned({6}));
  EXPECT_FALSE(islands.is_aligned({5}));
}

TEST(Frames, WithoutOneLeavesTheOthersAndNoConstraint) {
  const PoseGraph graph = graph_of({1, 2, 3, 4}, {{1, 2}, {3, 4}});
  const PoseGraph rest = Frames(graph).without({1}, graph);
  EXPECT_THAT(rest.nodes, testing::ElementsAre(testing::Key(CellId{3}), testing::Key(CellId{4})));
  EXPECT_TRUE(rest.constraints.empty());
}

TEST(Frames, AnEmptyMapHasNone) { EXPECT_EQ(Frames(PoseGraph{}).count(), 0u); }

TEST(Frames, ACellOutsideOfTheGraphIsNotFound) {
  const Frames islands(graph_of({1}, {}));
  test::expect_error(
      ErrorCode::kNotFound, [&] { islands.of({2}); }, "CELL 2");
}

}  // namespace
}  // namespace cellmap
