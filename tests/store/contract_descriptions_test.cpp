#include <gtest/gtest.h>

#include "cellmap/store/descriptions.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

CellDescription description(const NewCell& of, std::size_t size, std::uint8_t fill) {
  return {of.id, of.encoded.hash, Bytes(size, static_cast<std::byte>(fill))};
}

std::vector<CellId> numbers(std::initializer_list<std::uint32_t> values) {
  std::vector<CellId> ids;
  for (const std::uint32_t value : values) ids.push_back({value});
  return ids;
}

/// What the store has of these CELLs: number, first byte, size.
std::vector<std::array<std::size_t, 3>> kept(Store& store, std::initializer_list<std::uint32_t> of,
                                             const std::string& map = "town") {
  std::vector<std::array<std::size_t, 3>> found;
  for (const auto& one : descriptions_of(store).descriptions(map, numbers(of))) {
    EXPECT_EQ(one.hash, store.cell(map, one.cell).hash);
    found.push_back({one.cell.value, static_cast<std::size_t>(one.bytes.at(0)), one.bytes.size()});
  }
  return found;
}

using Kept = std::vector<std::array<std::size_t, 3>>;

TEST_P(StoreContract, DescriptionsAreKeptByCellAndFoundAgain) {
  store_->create_map("town", {});
  MapUpdate update;
  for (const std::uint32_t id : {1u, 2u, 3u, 9u, 40u}) update.cells.push_back(make_cell(id));
  store_->commit("town", update);
  const MapVersion before = store_->version("town");
  Descriptions& descriptions = descriptions_of(*store_);
  EXPECT_EQ(kept(*store_, {1, 2, 3}), Kept());
  descriptions.keep_descriptions(
      "town", {description(make_cell(1), 1213, 11), description(make_cell(3), 5, 13),
               description(make_cell(9), 7, 19), description(make_cell(40), 1, 40)});
  const Kept all = {{1, 11, 1213}, {3, 13, 5}, {9, 19, 7}, {40, 40, 1}};
  EXPECT_EQ(kept(*store_, {1, 2, 3, 9, 40, 77}), all);
  EXPECT_EQ(kept(*store_, {2, 9}), (Kept{{9, 19, 7}}));  // 3 lies between them in the table
  descriptions.keep_descriptions("town", {description(make_cell(3), 6, 14)});
  reopen();
  EXPECT_EQ(kept(*store_, {3}), (Kept{{3, 14, 6}}));
  EXPECT_EQ(kept(*store_, {}), Kept());
  EXPECT_EQ(store_->version("town"), before) << "no part of a revision";
}

TEST_P(StoreContract, ADescriptionOfAnotherCellThanTheOneThatIsThereIsNotKept) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2)}));
  Descriptions& descriptions = descriptions_of(*store_);
  descriptions.keep_descriptions("town", {description(make_cell(1), 5, 11)});
  MapUpdate other_bytes;
  other_bytes.recoded[CellId{1}] = {make_cell(1).encoded.hash, make_cell(9).encoded};
  store_->commit("town", other_bytes);
  EXPECT_EQ(kept(*store_, {1}), Kept()) << "it was made of other bytes";
  // Somebody was still at it; of a CELL that never was, too.
  descriptions.keep_descriptions(
      "town", {description(make_cell(1), 5, 11), description(make_cell(7), 5, 17)});
  EXPECT_EQ(kept(*store_, {1, 7}), Kept());
  CellDescription anew = description(make_cell(9), 5, 12);
  anew.cell = {1};
  descriptions.keep_descriptions("town", {anew});
  EXPECT_EQ(kept(*store_, {1}), (Kept{{1, 12, 5}}));
}

TEST_P(StoreContract, DescriptionsGoWithTheirCells) {
  for (const std::string map : {"town", "village"}) {
    store_->create_map(map, {});
    store_->commit(map, adding({make_cell(1), make_cell(2, pose_at(5, 0), "other")}));
    descriptions_of(*store_).keep_descriptions(
        map, {description(make_cell(1), 5, 11),
              description(make_cell(2, pose_at(5, 0), "other"), 5, 12)});
  }
  MapUpdate without;
  without.remove_sessions = {"drive"};
  store_->commit("town", without);
  EXPECT_EQ(kept(*store_, {1, 2}), (Kept{{2, 12, 5}}));
  EXPECT_EQ(kept(*store_, {1, 2}, "village").size(), 2u);
  store_->delete_map("town");
  expect_error(ErrorCode::kNotFound, [&] { kept(*store_, {1}); });
  expect_error(ErrorCode::kNotFound,
               [&] { descriptions_of(*store_).keep_descriptions("town", {}); });
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  EXPECT_EQ(kept(*store_, {1}), Kept());
}

TEST_P(StoreContract, ADescriptionThatIsNoneIsRefused) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1)}));
  expect_error(ErrorCode::kTooLarge, [&] {
    descriptions_of(*store_).keep_descriptions(
        "town", {description(make_cell(1), kMaxDescriptionBytes + 1, 1)});
  });
}

}  // namespace
}  // namespace cellmap::test
