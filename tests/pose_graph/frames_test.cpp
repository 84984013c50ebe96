#include "cellmap/pose_graph/frames.hpp"

#include <gmock/gmock.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

PoseGraph graph_of(std::initializer_list<std::uint32_t> cells,
                   std::initializer_list<std::pair<std::uint32_t, std::uint32_t>> ties,
                   std::initializer_list<std::uint32_t> unaligned) {
  PoseGraph graph;
  for (const auto cell : unaligned) graph.unaligned.insert({cell});
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
  const Frames frames(
      graph_of({2, 3, 5, 7, 8, 9}, {{9, 8}, {7, 3}, {8, 7}, {2, 5}}, {2, 3, 5, 7, 8, 9}));
  EXPECT_EQ(frames.count(), 2u);
  for (const auto cell : {3u, 7u, 8u, 9u}) EXPECT_EQ(frames.of({cell}), CellId{3});
  for (const auto cell : {2u, 5u}) EXPECT_EQ(frames.of({cell}), CellId{2});
}

TEST(Frames, AlignedCellsShareOneWhateverTiesThem) {
  const Frames frames(graph_of({4, 5, 6, 7}, {}, {5, 7}));
  EXPECT_EQ(frames.count(), 3u);
  EXPECT_EQ(frames.of({6}), CellId{4});
  EXPECT_EQ(frames.of({5}), CellId{5});
  EXPECT_EQ(frames.of({7}), CellId{7});
}

TEST(Frames, AConstraintToTheMapPutsAnUnalignedCellInItsFrame) {
  const Frames frames(graph_of({4, 5, 6}, {{5, 6}, {6, 4}}, {5, 6}));
  EXPECT_EQ(frames.count(), 1u);
}

TEST(Frames, WithoutOneLeavesTheOthersAndNoConstraint) {
  const PoseGraph graph = graph_of({1, 2, 3, 4}, {{1, 2}, {3, 4}}, {3, 4});
  const PoseGraph rest = Frames(graph).without({1}, graph);
  EXPECT_THAT(rest.nodes, testing::ElementsAre(testing::Key(CellId{3}), testing::Key(CellId{4})));
  EXPECT_TRUE(rest.constraints.empty());
}

TEST(Frames, AnEmptyMapHasNone) { EXPECT_EQ(Frames(PoseGraph{}).count(), 0u); }

TEST(Frames, ACellOutsideOfTheGraphIsNotFound) {
  const Frames frames(graph_of({1}, {}, {}));
  test::expect_error(
      ErrorCode::kNotFound, [&] { frames.of({2}); }, "CELL 2");
}

}  // namespace
}  // namespace cellmap
