#include <atomic>
#include <thread>
#include <vector>

#include "cellmap/store/known_cells.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

/// Asked for twice, since the second answer may be one that was kept.
void expect_current(const Store& store, const std::string& map, CellId id) {
  for (int i = 0; i < 2; ++i) {
    const CurrentCell current = store.current_cell(map, id);
    EXPECT_EQ(current.revision, store.version(map).revision);
    EXPECT_EQ(current.record.hash, store.cell(map, id).hash);
    EXPECT_EQ(current.record.moved, store.cell(map, id).moved);
    EXPECT_EQ(store.stored_cell(map, id).hash, current.record.hash);
  }
}

TEST_P(StoreContract, WhatWasAskedForIsNeverOlderThanTheLastChange) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2, pose_at(5, 0))}));
  expect_current(*store_, "town", {1});
  store_->commit("town", moving({{CellId{2}, pose_at(6, 0)}}));  // another CELL: the revision only
  expect_current(*store_, "town", {1});
  store_->commit("town", moving({{CellId{1}, pose_at(7, 0)}}));
  expect_current(*store_, "town", {1});
  EXPECT_DOUBLE_EQ(store_->current_cell("town", {1}).record.T_map_cell.translation().x(), 7);
  MapUpdate other_bytes;
  other_bytes.recoded[CellId{1}] = {make_cell(1).encoded.hash, make_cell(9).encoded};
  store_->commit("town", other_bytes);
  expect_current(*store_, "town", {1});
  EXPECT_EQ(store_->current_cell("town", {1}).record.hash, make_cell(9).encoded.hash);
}

TEST_P(StoreContract, WhatWasRemovedIsNotFoundHoweverOftenItWasAskedFor) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  expect_current(*store_, "town", {1});
  MapUpdate without;
  without.remove_sessions = {"drive"};
  store_->commit("town", without);
  expect_error(ErrorCode::kNotFound, [&] { store_->current_cell("town", {1}); });
  expect_error(ErrorCode::kNotFound, [&] { store_->stored_cell("town", {1}); });
  store_->commit("town", adding({make_cell(2)}));
  expect_current(*store_, "town", {2});
  store_->delete_map("town");
  expect_error(ErrorCode::kNotFound, [&] { store_->current_cell("town", {2}); });
  store_->create_map("town", {});
  expect_error(ErrorCode::kNotFound, [&] { store_->current_cell("town", {2}); });
}

TEST_P(StoreContract, WhoReadsBesideAWriterSeesEveryChangeThatWasMadeBeforeItAsked) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  std::atomic<Revision> committed = store_->version("town").revision;
  std::atomic<bool> done = false;
  std::vector<std::thread> readers;
  std::atomic<int> old = 0;
  for (int i = 0; i < 3; ++i) {
    readers.emplace_back([&] {
      while (!done) {
        const Revision before = committed;
        const CurrentCell cell = store_->current_cell("town", {1});
        // Every revision moves the CELL, so that both are of one state.
        if (cell.revision < before || cell.record.moved != cell.revision) ++old;
      }
    });
  }
  for (int i = 1; i <= 100; ++i) {
    committed = store_->commit("town", moving({{CellId{1}, pose_at(i, 0)}})).revision;
  }
  done = true;
  for (std::thread& reader : readers) reader.join();
  EXPECT_EQ(old, 0);
}

std::shared_ptr<const KnownCell> known(std::uint32_t id, Revision revision) {
  KnownCell cell;
  cell.revision = revision;
  cell.record.id = {id};
  return std::make_shared<const KnownCell>(cell);
}

TEST(KnownCells, AreForgottenWithEveryChange) {
  KnownCells cells;
  const std::uint64_t first = cells.state().value();
  cells.insert(first, "a", known(1, 1));
  ASSERT_TRUE(cells.find(first, "a", {1}));
  EXPECT_FALSE(cells.find(first, "a", {2}));
  EXPECT_FALSE(cells.find(first, "b", {1}));
  {
    const KnownCells::Change change(cells);
    EXPECT_FALSE(cells.state());
  }
  const std::uint64_t second = cells.state().value();
  EXPECT_FALSE(cells.find(second, "a", {1}));
  cells.insert(second, "a", known(1, 2));
  cells.insert(first, "a", known(2, 1));  // by a reader that the change overtook
  EXPECT_EQ(cells.find(second, "a", {1})->revision, 2u);
  EXPECT_FALSE(cells.find(second, "a", {2}));
}

}  // namespace
}  // namespace cellmap::test
