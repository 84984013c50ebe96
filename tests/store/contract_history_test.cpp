#include <gmock/gmock.h>

#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

void expect_equal(const PoseGraph& found, const PoseGraph& expected) {
  EXPECT_EQ(found.revision, expected.revision);
  ASSERT_EQ(found.nodes.size(), expected.nodes.size());
  for (const auto& [id, pose] : expected.nodes) {
    EXPECT_EQ(found.nodes.at(id).matrix(), pose.matrix()) << id.value;
  }
  ASSERT_EQ(found.constraints.size(), expected.constraints.size());
  for (std::size_t i = 0; i < expected.constraints.size(); ++i) {
    EXPECT_EQ(found.constraints[i].id, expected.constraints[i].id);
    EXPECT_EQ(found.constraints[i].T_from_to.matrix(), expected.constraints[i].T_from_to.matrix());
  }
}

/// Random updates and the pose graph that a plain std::map says each leads to.
class History {
 public:
  explicit History(Store& store) : store_(store) { graphs_.push_back(store.pose_graph("town")); }

  const std::vector<PoseGraph>& graphs() const { return graphs_; }

  void step() {
    PoseGraph next = graphs_.back();
    MapUpdate update;
    const std::uint32_t id = static_cast<std::uint32_t>(next.nodes.size());
    update.cells = {make_cell(id, random_pose())};
    next.nodes[{id}] = update.cells[0].T_map_cell;
    for (auto& [known, pose] : next.nodes) {
      if (random_() % 3 == 0) update.poses[known] = pose = random_pose();
    }
    if (id > 0) update.add_constraints = {make_constraint(id - 1, id)};
    if (next.constraints.size() > 2 && random_() % 2 == 0) {
      update.remove_constraints = {next.constraints[1].id};
      next.constraints.erase(next.constraints.begin() + 1);
    }
    const CommitResult result = store_.commit("town", update);
    next.revision += 1;
    EXPECT_EQ(result.revision, next.revision);
    for (std::size_t i = 0; i < update.add_constraints.size(); ++i) {
      next.constraints.push_back(update.add_constraints[i]);
      next.constraints.back().id = result.constraint_ids[i];
    }
    graphs_.push_back(next);
  }

 private:
  Pose random_pose() {
    std::uniform_real_distribution<double> anywhere(-500, 500);
    return pose_at(anywhere(random_), anywhere(random_), anywhere(random_), anywhere(random_));
  }

  Store& store_;
  std::mt19937 random_{3};
  std::vector<PoseGraph> graphs_;
};

TEST_P(StoreContract, EveryOldRevisionOfThePoseGraphCanBeRead) {
  store_->create_map("town", {});
  History history(*store_);
  for (int i = 0; i < 25; ++i) history.step();
  for (const PoseGraph& graph : history.graphs()) {
    expect_equal(store_->pose_graph("town", graph.revision), graph);
  }
  expect_equal(store_->pose_graph("town"), history.graphs().back());
  expect_error(
      ErrorCode::kNotFound, [&] { store_->pose_graph("town", 26); }, "revision 26");
}

/// What a client holds after it has followed the changes.
void follow(PoseGraph& graph, const MapChanges& changes) {
  EXPECT_EQ(changes.since, graph.revision);
  graph.revision = changes.revision;
  for (const CellRecord& cell : changes.added) {
    EXPECT_FALSE(graph.nodes.contains(cell.id));
    graph.nodes[cell.id] = cell.T_map_cell;
  }
  for (const auto& [id, pose] : changes.moved) graph.nodes.at(id) = pose;
  for (const ConstraintId id : changes.removed_constraints) {
    EXPECT_EQ(std::erase_if(graph.constraints, [&](const auto& c) { return c.id == id; }), 1u);
  }
  for (const Constraint& constraint : changes.added_constraints) {
    graph.constraints.push_back(constraint);
  }
}

TEST_P(StoreContract, ChangesLeadFromAnyRevisionToTheNewest) {
  store_->create_map("town", {});
  History history(*store_);
  for (int i = 0; i < 25; ++i) history.step();
  for (PoseGraph graph : history.graphs()) {
    follow(graph, store_->changes("town", graph.revision));
    expect_equal(graph, history.graphs().back());
  }
}

TEST_P(StoreContract, ChangesTellAddedFromMovedAndHideWhatCameAndWent) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2)}));
  MapUpdate update = adding({make_cell(3)});
  update.poses = {{{1}, pose_at(4, 4)}};
  update.add_constraints = {make_constraint(1, 2)};
  const ConstraintId gone = store_->commit("town", update).constraint_ids.at(0);
  MapUpdate removal;
  removal.remove_constraints = {gone};
  store_->commit("town", removal);

  const MapChanges since_first = store_->changes("town", 1);
  EXPECT_EQ(since_first.revision, 3u);
  EXPECT_THAT(ids_of(since_first.added), ElementsAre(3));
  ASSERT_EQ(since_first.moved.size(), 1u);
  EXPECT_EQ(since_first.moved.at({1}).matrix(), pose_at(4, 4).matrix());
  EXPECT_THAT(since_first.added_constraints, IsEmpty());
  EXPECT_THAT(since_first.removed_constraints, IsEmpty());
  EXPECT_THAT(store_->changes("town", 2).removed_constraints, ElementsAre(gone));

  const MapChanges none = store_->changes("town", 3);
  EXPECT_TRUE(none.added.empty() && none.moved.empty() && none.removed_constraints.empty());
  expect_error(
      ErrorCode::kNotFound, [&] { store_->changes("town", 4); }, "revision 4");
}

TEST_P(StoreContract, MapsHaveRevisionsAndNumbersOfTheirOwn) {
  store_->create_map("town", {});
  store_->create_map("other", {});
  store_->commit("town", adding({make_cell(1), make_cell(2)}));
  store_->commit("town", joining({make_constraint(1, 2)}));
  EXPECT_EQ(store_->map("other").revision, 0u);
  store_->commit("other", adding({make_cell(1, pose_at(8, 8)), make_cell(2)}));
  EXPECT_EQ(store_->map("other").revision, 1u);
  EXPECT_EQ(store_->cell("town", {1}).T_map_cell.matrix(), Pose::Identity().matrix());
  MapUpdate removal;
  removal.remove_constraints = {store_->pose_graph("town").constraints.at(0).id};
  expect_error(
      ErrorCode::kNotFound, [&] { store_->commit("other", removal); }, "no constraint");
}

}  // namespace
}  // namespace cellmap::test
