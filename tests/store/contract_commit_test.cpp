#include <gmock/gmock.h>

#include <limits>

#include "cellmap/codec/zstd.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

using ::testing::ElementsAre;

TEST_P(StoreContract, ACellComesBackAsItWasCommitted) {
  store_->create_map("town", {});
  const NewCell made = make_cell(7, pose_at(-1.25, 1e6 + 0.1, 3, 2.0), "drive", 100'000);
  EXPECT_EQ(store_->commit("town", adding({made})).revision, 1u);

  const CellRecord cell = store_->cell("town", {7});
  EXPECT_EQ(cell.hash, made.encoded.hash);
  EXPECT_EQ(cell.added, 1u);
  EXPECT_EQ(cell.moved, 1u);
  EXPECT_EQ(cell.T_map_cell.matrix(), made.T_map_cell.matrix());
  EXPECT_EQ(cell.session, "drive");
  EXPECT_EQ(cell.sequence, 7u);
  EXPECT_EQ(cell.planes, 3u);
  EXPECT_EQ(cell.encoded_bytes, 100'000u);
  for (int time = 0; time < 2; ++time) {  // from the disk, from a cache
    EXPECT_EQ(zstd_decompress(*store_->compressed_cell("town", {7}), 100'000), made.encoded.bytes);
  }
  expect_error(
      ErrorCode::kNotFound, [&] { store_->cell("town", {8}); }, "CELL 8");
  expect_error(
      ErrorCode::kNotFound, [&] { store_->compressed_cell("town", {8}); }, "CELL 8");
}

TEST_P(StoreContract, CellIdsReachFromZeroToTheEndOf32Bits) {
  store_->create_map("town", {});
  const std::uint32_t most = std::numeric_limits<std::uint32_t>::max();
  store_->commit("town", adding({make_cell(0), make_cell(most)}));
  EXPECT_THAT(ids_of(store_->cells("town", {}).cells), ElementsAre(0u, most));
}

TEST_P(StoreContract, CommittingTheSameCellAgainChangesNothing) {
  store_->create_map("town", {});
  MapUpdate update = adding({make_cell(1), make_cell(2)});
  update.add_constraints = {make_constraint(1, 2)};
  update.cells[0].voxel_points = 5;
  const CommitResult first = store_->commit("town", update);
  const CommitResult second = store_->commit("town", update);
  EXPECT_EQ(second.revision, first.revision);
  EXPECT_EQ(second.constraint_ids, first.constraint_ids);
  EXPECT_EQ(store_->map("town").cells, 2u);
  EXPECT_EQ(store_->map("town").constraints, 1u);
}

TEST_P(StoreContract, AnEmptyUpdateKeepsTheRevision) {
  store_->create_map("town", {});
  EXPECT_EQ(store_->commit("town", {}).revision, 0u);
  store_->commit("town", adding({make_cell(1, pose_at(1, 2))}));
  EXPECT_EQ(store_->commit("town", moving({{{1}, pose_at(1, 2)}})).revision, 1u);
}

TEST_P(StoreContract, ACellNeverChangesItsContent) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  NewCell other = make_cell(1, Pose::Identity(), "elsewhere");
  expect_error(
      ErrorCode::kConflict, [&] { store_->commit("town", adding({other})); }, "CELL 1");
}

TEST_P(StoreContract, APlaceInASessionIsTakenOnce) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  NewCell twin = make_cell(1);
  twin.id = {2};
  expect_error(
      ErrorCode::kConflict, [&] { store_->commit("town", adding({twin})); }, "CELL 1");
}

TEST_P(StoreContract, AHashThatIsThatOfOtherBytesIsRefused) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  NewCell liar = make_cell(2, Pose::Identity(), "drive", 300);
  liar.encoded.hash = make_cell(1).encoded.hash;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->commit("town", adding({liar})); }, "other bytes");
}

TEST_P(StoreContract, AnotherLatticeIsRefused) {
  store_->create_map("town", {});
  NewCell made = make_cell(1);
  Cell coarse = *made.cell;
  coarse.lattice.size = 20'000;
  made.cell = std::make_shared<const Cell>(coarse);
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->commit("town", adding({made})); }, "lattice");
}

TEST_P(StoreContract, AFailedUpdateChangesNothingAtAll) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  MapUpdate update = adding({make_cell(2)});
  update.poses = {{{1}, pose_at(9, 9)}, {{77}, pose_at(0, 0)}};
  expect_error(
      ErrorCode::kNotFound, [&] { store_->commit("town", update); }, "CELL 77");
  EXPECT_EQ(store_->map("town").revision, 1u);
  EXPECT_EQ(store_->map("town").cells, 1u);
  EXPECT_EQ(store_->cell("town", {1}).T_map_cell.matrix(), Pose::Identity().matrix());
  expect_error(
      ErrorCode::kNotFound, [&] { store_->cell("town", {2}); }, "CELL 2");
  EXPECT_EQ(store_->commit("town", adding({make_cell(2)})).revision, 2u);
}

TEST_P(StoreContract, AnExpectedRevisionThatHasPassedIsRefused) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  MapUpdate update = adding({make_cell(2)});
  for (const Revision wrong : {Revision{0}, Revision{2}}) {
    update.expected_revision = wrong;
    expect_error(
        ErrorCode::kPreconditionFailed, [&] { store_->commit("town", update); }, "revision 1");
  }
  update.expected_revision = 1;
  EXPECT_EQ(store_->commit("town", update).revision, 2u);
}

TEST_P(StoreContract, ACellMayBeAddedMovedAndJoinedByOneUpdate) {
  store_->create_map("town", {});
  MapUpdate update = adding({make_cell(1), make_cell(2)});
  update.poses = {{{2}, pose_at(5, 6, 7, 1)}};
  update.add_constraints = {make_constraint(1, 2)};
  EXPECT_EQ(store_->commit("town", update).revision, 1u);
  EXPECT_EQ(store_->pose_graph("town").nodes.at({2}).matrix(), pose_at(5, 6, 7, 1).matrix());
  const MapChanges changes = store_->changes("town", 0);
  EXPECT_EQ(changes.added.size(), 2u);
  EXPECT_TRUE(changes.moved.empty());
}

TEST_P(StoreContract, ConstraintsComeBackAsTheyWereCommitted) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2)}));
  const Constraint made = make_constraint(1, 2, ConstraintKind::kLoop);
  const CommitResult result = store_->commit("town", joining({made}));
  const Constraint back = store_->pose_graph("town").constraints.at(0);
  EXPECT_EQ(back.id, result.constraint_ids.at(0));
  EXPECT_EQ(back.from, made.from);
  EXPECT_EQ(back.to, made.to);
  EXPECT_EQ(back.kind, made.kind);
  EXPECT_EQ(back.origin, made.origin);
  EXPECT_EQ(back.T_from_to.matrix(), made.T_from_to.matrix());
  EXPECT_EQ(back.information, made.information);
  EXPECT_EQ(back.scores.points, 1000u);
  EXPECT_EQ(back.scores.hits, 900u);
  EXPECT_EQ(back.scores.inlier_ratio_all, 0.4);
  EXPECT_EQ(back.scores.inlier_ratio_hit, 0.9);
  EXPECT_EQ(back.scores.share_in_front, 0.01);
  EXPECT_EQ(back.scores.share_beyond, 0.02);
  EXPECT_EQ(back.scores.median_residual_m, 0.03);
}

TEST_P(StoreContract, ConstraintsAreNumberedInOrderAndNumbersAreNotUsedAgain) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2), make_cell(3)}));
  const auto ids = store_->commit("town", joining({make_constraint(1, 2), make_constraint(2, 3)}))
                       .constraint_ids;
  ASSERT_EQ(ids.size(), 2u);
  EXPECT_GT(ids[0].value, 0u);
  EXPECT_LT(ids[0], ids[1]);
  MapUpdate removal;
  removal.remove_constraints = {ids[1]};
  EXPECT_EQ(store_->commit("town", removal).revision, 3u);
  EXPECT_EQ(store_->map("town").constraints, 1u);
  expect_error(
      ErrorCode::kNotFound, [&] { store_->commit("town", removal); }, "no constraint");
  const auto again = store_->commit("town", joining({make_constraint(2, 3)})).constraint_ids;
  EXPECT_LT(ids[1], again.at(0));
}

TEST_P(StoreContract, ConstraintsNeedTheirCells) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  for (const Constraint& constraint : {make_constraint(1, 5), make_constraint(5, 1)}) {
    expect_error(
        ErrorCode::kNotFound, [&] { store_->commit("town", joining({constraint})); }, "CELL 5");
  }
}

TEST_P(StoreContract, PosesThatCannotBeAreRefused) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  Pose skewed = Pose::Identity();
  skewed.matrix()(0, 1) = 0.5;
  for (const Pose& bad : {pose_at(std::nan(""), 0), pose_at(0, 1.1e7),
                          pose_at(0, 0, -std::numeric_limits<double>::infinity()), skewed}) {
    expect_error(
        ErrorCode::kInvalidArgument,
        [&] {
          store_->commit("town", moving({{{1}, bad}}));
        },
        "T_map_cell");
    expect_error(
        ErrorCode::kInvalidArgument, [&] { store_->commit("town", adding({make_cell(2, bad)})); },
        "T_map_cell");
    Constraint constraint = make_constraint(1, 2);
    constraint.T_from_to = bad;
    expect_error(
        ErrorCode::kInvalidArgument, [&] { store_->commit("town", joining({constraint})); },
        "T_from_to");
  }
  EXPECT_NO_THROW(store_->commit("town", moving({{{1}, pose_at(1e7, -1e7, 1e7)}})));
}

TEST_P(StoreContract, MalformedUpdatesAreRefused) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2)}));
  const auto refused = [&](const MapUpdate& update, const std::string& part) {
    expect_error(
        ErrorCode::kInvalidArgument, [&] { store_->commit("town", update); }, part);
  };
  refused(adding({make_cell(3), make_cell(3)}), "twice");
  refused(adding({make_cell(3, Pose::Identity(), "a/b")}), "session");
  NewCell empty = make_cell(3);
  empty.encoded.bytes.clear();
  refused(adding({empty}), "bytes");
  NewCell hollow = make_cell(3);
  hollow.cell = nullptr;
  refused(adding({hollow}), "content");
  refused(joining({make_constraint(1, 1)}), "itself");
  Constraint lopsided = make_constraint(1, 2);
  lopsided.information(0, 1) = 9;
  refused(joining({lopsided}), "information");
  Constraint unknown = make_constraint(1, 2);
  unknown.kind = static_cast<ConstraintKind>(9);
  refused(joining({unknown}), "kind");
  EXPECT_EQ(store_->map("town").revision, 1u);
}

TEST_P(StoreContract, ScansComeBackInOrderOfSequence) {
  store_->create_map("town", {});
  std::vector<NewCell> made = {make_cell(1), make_cell(2), make_cell(3, Pose::Identity(), "b")};
  std::swap(made[0].id, made[1].id);  // ids against the order of the drive
  made[1].scans.clear();
  store_->commit("town", adding(made));
  const std::vector<CellScans> scans = store_->scans("town", "drive");
  ASSERT_EQ(scans.size(), 2u);
  EXPECT_EQ(scans[0].cell, CellId{2});
  EXPECT_EQ(scans[0].T_odom_cell.matrix(), made[0].cell->T_odom_cell.matrix());
  ASSERT_EQ(scans[0].scans.size(), 2u);
  EXPECT_EQ(scans[0].scans[1].stamp, made[0].scans[1].stamp);
  EXPECT_EQ(scans[0].scans[1].T_cell_scan.matrix(), made[0].scans[1].T_cell_scan.matrix());
  EXPECT_TRUE(scans[1].scans.empty());
  EXPECT_TRUE(store_->scans("town", "unknown").empty());
}

TEST_P(StoreContract, TheLastCellOfASessionIsThatOfTheHighestSequence) {
  store_->create_map("town", {});
  EXPECT_FALSE(store_->last_cell("town", "drive"));
  std::vector<NewCell> made = {make_cell(1), make_cell(2), make_cell(9, Pose::Identity(), "b")};
  std::swap(made[0].id, made[1].id);
  store_->commit("town", adding(made));
  EXPECT_EQ(store_->last_cell("town", "drive")->sequence, 2u);
  EXPECT_EQ(store_->last_cell("town", "drive")->id, CellId{1});
  EXPECT_FALSE(store_->last_cell("town", "unknown"));
}

}  // namespace
}  // namespace cellmap::test
