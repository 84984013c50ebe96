#include "cellmap/store/copy_map.hpp"

#include <gtest/gtest.h>

#include "cellmap/store/documents.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

/// A map with history: CELLs that moved, a session that is not aligned, constraints of which one
/// was removed and one judged, a document.
void fill(Store& store) {
  store.create_map("other", {});
  store.create_map("town", {});
  NewCell lost = make_cell(3, pose_at(50, 0), "lost");
  lost.unaligned = true;
  store.commit("town", adding({make_cell(1, pose_at(0, 0)), make_cell(2, pose_at(6, 0)), lost}));
  store.commit("other", adding({make_cell(1, pose_at(0, 0))}));
  store.commit("town", joining({make_constraint(1, 2), make_constraint(1, 3)}));
  MapUpdate update = moving({{CellId{2}, pose_at(6.5, 0.25, 0.125, 0.1)}});
  update.remove_constraints = {ConstraintId{2}};
  update.judged[ConstraintId{1}] = {0.25, true};
  store.commit("town", update);
  documents_of(store).put_document("town", "comparison", "{\"rows\": []}");
}

void expect_same(const PoseGraph& a, const PoseGraph& b) {
  EXPECT_EQ(a.unaligned, b.unaligned);
  EXPECT_EQ(a.next_cell.value, b.next_cell.value);
  ASSERT_EQ(a.nodes.size(), b.nodes.size());
  for (const auto& [id, T] : a.nodes) EXPECT_EQ(T.matrix(), b.nodes.at(id).matrix());
  ASSERT_EQ(a.constraints.size(), b.constraints.size());
  for (std::size_t i = 0; i < a.constraints.size(); ++i) {
    EXPECT_EQ(a.constraints[i].id.value, b.constraints[i].id.value);
    EXPECT_EQ(a.constraints[i].T_from_to.matrix(), b.constraints[i].T_from_to.matrix());
    EXPECT_EQ(a.constraints[i].information, b.constraints[i].information);
    EXPECT_EQ(a.constraints[i].weight, b.constraints[i].weight);
    EXPECT_EQ(a.constraints[i].pinned, b.constraints[i].pinned);
  }
}

void expect_same(const Store& a, const Store& b) {
  const MapInfo there = a.map("town"), here = b.map("town");
  EXPECT_EQ(there.revision, here.revision);
  EXPECT_EQ(there.created, here.created);
  EXPECT_EQ(there.stored_bytes, here.stored_bytes);
  EXPECT_EQ(there.sessions, here.sessions);
  EXPECT_EQ(there.constraints, here.constraints);
  for (Revision revision = 0; revision <= there.revision; ++revision) {
    SCOPED_TRACE(revision);
    expect_same(a.pose_graph("town", revision), b.pose_graph("town", revision));
  }
  for (const std::uint32_t id : {1, 2, 3}) {
    EXPECT_EQ(*a.stored_cell("town", {id}).frame, *b.stored_cell("town", {id}).frame);
    EXPECT_EQ(a.cell("town", {id}).hash, b.cell("town", {id}).hash);
  }
  for (const char* const session : {"drive", "lost"}) {
    const auto scans = a.scans("town", session), copied = b.scans("town", session);
    ASSERT_EQ(scans.size(), copied.size());
    for (std::size_t i = 0; i < scans.size(); ++i) {
      EXPECT_EQ(scans[i].scans.size(), copied[i].scans.size());
    }
  }
}

TEST_P(StoreContract, AMapArrivesWithItsHistoryAndComesBackTheSame) {
  const auto source = open_sqlite_store(folder_ / "source.db");
  fill(*source);
  std::uint64_t told = 0;
  const CopiedMap copied = copy_map(*source, *store_, "town", {},
                                    [&](std::uint64_t cells, std::uint64_t) { told = cells; });
  EXPECT_EQ(copied.cells, 3u);
  EXPECT_EQ(told, 3u);
  expect_same(*source, *store_);
  EXPECT_EQ(documents_of(*store_).document("town", "comparison"), "{\"rows\": []}");
  const auto back = open_sqlite_store(folder_ / "back.db");
  copy_map(*store_, *back, "town");
  expect_same(*source, *back);
  // It goes on where the source would.
  EXPECT_EQ(back->commit("town", joining({make_constraint(2, 3)})).constraint_ids,
            store_->commit("town", joining({make_constraint(2, 3)})).constraint_ids);
}

TEST_P(StoreContract, ATakenNameIsRefusedAndNothingIsLeftBehind) {
  const auto source = open_sqlite_store(folder_ / "source.db");
  fill(*source);
  store_->create_map("town", {});
  expect_error(ErrorCode::kAlreadyExists, [&] { copy_map(*source, *store_, "town"); });
  expect_error(ErrorCode::kNotFound, [&] { copy_map(*source, *store_, "city"); });
  std::stop_source stop;
  stop.request_stop();
  expect_error(ErrorCode::kCancelled,
               [&] { copy_map(*source, *store_, "other", stop.get_token()); });
  EXPECT_EQ(store_->maps().size(), 1u);
}

}  // namespace
}  // namespace cellmap::test
