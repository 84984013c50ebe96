#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "cellmap/store/read_cell.hpp"
#include "store/store_contract.hpp"

namespace cellmap::test {

/// The bytes that a CELL may be brought into; other maps bring the same CELL into the same.
inline RecodedCell other_bytes_of(std::uint32_t id, const ContentHash& from) {
  return {from, make_cell(1000 + id).encoded};
}

/// One map takes CELLs and loses them again, at random. All maps take the same ones, so that each
/// content is named by one map while another one leaves it. Ends with CELLs.
inline void take_and_leave(Store& store, const std::string& map, int turns) {
  constexpr std::uint32_t kCells = 5;
  std::mt19937_64 random(std::hash<std::string>()(map));
  for (int turn = 0; turn < turns; ++turn) {
    std::vector<std::uint32_t> ids = {1};
    for (std::uint32_t id = 2; id <= kCells; ++id) {
      if (random() % 2 == 0) ids.push_back(id);
    }
    std::shuffle(ids.begin(), ids.end(), random);
    std::vector<NewCell> cells;
    for (const std::uint32_t id : ids) cells.push_back(make_cell(id));
    store.commit(map, adding(cells));
    MapUpdate recoding;
    for (const NewCell& cell : cells) {
      if (random() % 2 == 0) {
        recoding.recoded[cell.id] = other_bytes_of(cell.id.value, cell.encoded.hash);
      }
    }
    store.commit(map, recoding);
    MapUpdate removal;
    removal.remove_sessions = {"drive"};
    if (turn % 3 == 0) removal.cells = {make_cell(kCells + 1)};
    if (turn + 1 < turns) store.commit(map, removal);
  }
}

/// Maps m0, m1 and so on at the same time, one in each of the stores, which share a database.
inline void race_for_contents(const std::vector<Store*>& stores, int turns) {
  for (std::size_t i = 0; i < stores.size(); ++i) {
    stores[i]->create_map("m" + std::to_string(i), {});
  }
  {
    std::vector<std::jthread> threads;
    for (std::size_t i = 0; i < stores.size(); ++i) {
      threads.emplace_back(
          [&, i] { EXPECT_NO_THROW(take_and_leave(*stores[i], "m" + std::to_string(i), turns)); });
    }
  }
  for (std::size_t i = 0; i < stores.size(); ++i) {
    const std::string map = "m" + std::to_string(i);
    const CellPage page = stores.front()->cells(map, {});
    EXPECT_FALSE(page.cells.empty());
    for (const CellRecord& cell : page.cells) {
      EXPECT_EQ(stores.front()->stored_cell(map, cell.id).hash, cell.hash);
      EXPECT_FALSE(stores.front()->compressed_cell(map, cell.id)->empty());
    }
  }
}

}  // namespace cellmap::test
