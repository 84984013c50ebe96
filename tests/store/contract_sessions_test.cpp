#include <gmock/gmock.h>

#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

MapUpdate judging(ConstraintId id, double weight, bool pinned) {
  MapUpdate update;
  update.judged[id] = {weight, pinned};
  return update;
}

TEST_P(StoreContract, WhatIsThoughtOfAConstraintIsKept) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2)}));
  Constraint born_rejected = make_constraint(1, 2);
  born_rejected.weight = 0;
  const ConstraintId id = store_->commit("town", joining({born_rejected})).constraint_ids.at(0);
  reopen();
  EXPECT_EQ(store_->pose_graph("town").constraints.at(0).weight, 0);
  EXPECT_FALSE(store_->pose_graph("town").constraints.at(0).pinned);

  EXPECT_EQ(store_->commit("town", judging(id, 0.25, true)).revision, 3u);
  EXPECT_EQ(store_->commit("town", judging(id, 0.25, true)).revision, 3u) << "nothing new";
  reopen();
  EXPECT_EQ(judgement(store_->pose_graph("town").constraints.at(0)), (Judgement{0.25, true}));
  const MapChanges changes = store_->changes("town", 2);
  EXPECT_THAT(changes.added_constraints, IsEmpty());
  EXPECT_EQ(changes.judged, (std::map<ConstraintId, Judgement>{{id, {0.25, true}}}));
  EXPECT_THAT(store_->changes("town", 3).judged, IsEmpty());
  EXPECT_THAT(store_->changes("town", 1).judged, IsEmpty()) << "it comes with the constraint";
  EXPECT_EQ(store_->changes("town", 1).added_constraints.at(0).weight, 0.25);

  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->commit("town", judging(id, 1.5, false)); },
      "weight");
  expect_error(
      ErrorCode::kNotFound, [&] { store_->commit("town", judging({99}, 1, false)); }, "99");
}

/// Two CELLs of one session and then one of another, all tied together. Returns what the map was
/// before the last.
MapInfo fill_town(Store& store) {
  store.create_map("town", {});
  store.commit("town", adding({make_cell(1), make_cell(2, pose_at(7, 0))}));
  NewCell third = make_cell(3, pose_at(100, 0), "evening");
  third.raw_points = 500;
  third.voxel_points = 50;
  third.scans.resize(4);
  const MapInfo before = store.map("town");
  store.commit("town", adding({third}));
  store.commit("town", joining({make_constraint(1, 2), make_constraint(2, 3)}));
  return before;
}

MapUpdate removal() {
  MapUpdate update;
  update.remove_sessions = {"evening"};
  return update;
}

TEST_P(StoreContract, ARemovedSessionLeavesTheRestAsIfItHadNeverBeen) {
  const MapInfo before = fill_town(*store_);
  EXPECT_EQ(store_->commit("town", removal()).revision, 4u);
  reopen();
  const MapInfo after = store_->map("town");
  EXPECT_EQ(after.cells, 2u);
  EXPECT_EQ(after.constraints, 1u);
  EXPECT_EQ(after.planes, before.planes);
  EXPECT_EQ(after.encoded_bytes, before.encoded_bytes);
  EXPECT_EQ(after.stored_bytes, before.stored_bytes);
  EXPECT_EQ(after.scans, before.scans);
  EXPECT_EQ(after.raw_points, before.raw_points);
  EXPECT_EQ(after.voxel_points, before.voxel_points);
  EXPECT_THAT(after.sessions, ElementsAre("drive"));
  EXPECT_EQ(after.bounds.max().x(), 7);
  const PoseGraph graph = store_->pose_graph("town");
  EXPECT_EQ(graph.nodes.size(), 2u);
  EXPECT_EQ(graph.constraints.size(), 1u);
  EXPECT_THAT(store_->scans("town", "evening"), IsEmpty());
  expect_error(
      ErrorCode::kNotFound, [&] { store_->compressed_cell("town", {3}); }, "3");
  expect_error(
      ErrorCode::kNotFound, [&] { store_->commit("town", removal()); }, "evening");
}

TEST_P(StoreContract, ARemovedSessionMakesOlderRevisionsUnreadable) {
  fill_town(*store_);
  store_->commit("town", removal());
  expect_error(
      ErrorCode::kNotFound, [&] { store_->pose_graph("town", 3); }, "start from 0");
  expect_error(
      ErrorCode::kNotFound, [&] { store_->changes("town", 3); }, "start from 0");
  EXPECT_EQ(store_->changes("town", 0).added.size(), 2u);
  EXPECT_EQ(store_->changes("town", 4).revision, 4u);
}

TEST_P(StoreContract, ARemovedSessionGivesNoIdTwiceAndMayComeAgain) {
  fill_town(*store_);
  store_->commit("town", removal());
  EXPECT_EQ(store_->pose_graph("town").new_cell_id(), CellId{4});
  reopen();
  EXPECT_EQ(store_->pose_graph("town").new_cell_id(), CellId{4});
  store_->commit("town", adding({make_cell(4, pose_at(100, 0), "evening")}));
  EXPECT_EQ(store_->last_cell("town", "evening")->id, CellId{4});
}

TEST_P(StoreContract, ARemovedSessionKeepsBytesThatAnotherMapUses) {
  fill_town(*store_);
  store_->create_map("copy", {});
  store_->commit("copy", adding({make_cell(3, pose_at(0, 0), "evening")}));
  store_->commit("town", removal());
  reopen();
  EXPECT_FALSE(store_->compressed_cell("copy", {3})->empty());
}

TEST_P(StoreContract, AGeoreferenceIsKeptAndTakenAway) {
  store_->create_map("town", {});
  EXPECT_FALSE(store_->map("town").georeference);
  Georeference georeference{48.1, -11.5, 520.25, pose_at(0, 0, 0, 0.5).linear()};
  store_->set_georeference("town", georeference);
  reopen();
  const auto kept = store_->map("town").georeference;
  ASSERT_TRUE(kept);
  EXPECT_EQ(kept->latitude_deg, 48.1);
  EXPECT_EQ(kept->longitude_deg, -11.5);
  EXPECT_EQ(kept->height_m, 520.25);
  EXPECT_EQ(kept->R_enu_map, georeference.R_enu_map);
  EXPECT_EQ(store_->map("town").revision, 0u);
  for (const auto& spoil : std::vector<std::function<void(Georeference&)>>{
           [](auto& g) { g.latitude_deg = 90.5; }, [](auto& g) { g.longitude_deg = NAN; },
           [](auto& g) { g.height_m = 1e9; }, [](auto& g) { g.R_enu_map(0, 0) = 2; }}) {
    Georeference wrong = georeference;
    spoil(wrong);
    expect_error(
        ErrorCode::kInvalidArgument, [&] { store_->set_georeference("town", wrong); },
        "georeference");
  }
  store_->set_georeference("town", {});
  EXPECT_FALSE(store_->map("town").georeference);
  expect_error(
      ErrorCode::kNotFound, [&] { store_->set_georeference("none", georeference); }, "none");
}

}  // namespace
}  // namespace cellmap::test
