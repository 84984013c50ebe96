#include <gmock/gmock.h>

#include "cellmap/codec/zstd.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

TEST_P(StoreContract, ANewStoreHasNoMapsAndIsReady) {
  EXPECT_THAT(store_->maps(), IsEmpty());
  EXPECT_NO_THROW(store_->check_ready());
}

TEST_P(StoreContract, ANewMapIsEmptyAtRevisionZero) {
  LatticeSpec lattice;
  lattice.size = 20'000;
  const MapInfo created = store_->create_map("town", lattice);
  EXPECT_EQ(created.name, "town");
  EXPECT_GT(created.created, 1'500'000'000LL * 1'000'000'000LL);
  const MapInfo map = store_->map("town");
  EXPECT_EQ(map.lattice, lattice);
  EXPECT_EQ(map.revision, 0u);
  EXPECT_EQ(map.created, created.created);
  EXPECT_TRUE(map.bounds.isEmpty());
  EXPECT_THAT(map.sessions, IsEmpty());
  EXPECT_TRUE(store_->pose_graph("town").nodes.empty());
  EXPECT_TRUE(store_->nearest("town", {0, 0, 0}, 5).empty());
}

TEST_P(StoreContract, MapsComeByNameAndANameIsTakenOnce) {
  for (const char* name : {"b", "a-1", "c_2"}) store_->create_map(name, {});
  std::vector<std::string> names;
  for (const MapInfo& map : store_->maps()) names.push_back(map.name);
  EXPECT_THAT(names, ElementsAre("a-1", "b", "c_2"));
  expect_error(
      ErrorCode::kAlreadyExists, [&] { store_->create_map("b", {}); }, "b");
}

TEST_P(StoreContract, MapNamesAndLatticesAreChecked) {
  for (const std::string& name :
       {std::string(), std::string("-a"), std::string("A"), std::string("a/b"), std::string("a b"),
        std::string(65, 'a'), std::string("a\0b", 3), std::string("a'; DROP TABLE map; --")}) {
    expect_error(
        ErrorCode::kInvalidArgument, [&] { store_->create_map(name, {}); }, "map name");
  }
  EXPECT_NO_THROW(store_->create_map(std::string(64, 'a'), {}));
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->create_map("../etc\n", {}); }, "'../etc?'");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->create_map(std::string(65, 'a'), {}); },
      "'" + std::string(64, 'a') + "...'");
  LatticeSpec lattice;
  lattice.size = 3;
  expect_error(
      ErrorCode::kUnsupported, [&] { store_->create_map("b", lattice); }, "3");
}

TEST_P(StoreContract, EveryVerbOnAnUnknownMapSaysNotFound) {
  store_->create_map("town", {});
  const std::vector<std::function<void()>> verbs = {
      [&] { store_->map("x"); },
      [&] { store_->delete_map("x"); },
      [&] { store_->commit("x", {}); },
      [&] { store_->cells("x", {}); },
      [&] { store_->cell("x", {1}); },
      [&] {
        store_->nearest("x", {0, 0, 0}, 1);
      },
      [&] { store_->compressed_cell("x", {1}); },
      [&] { store_->last_cell("x", "drive"); },
      [&] { store_->pose_graph("x"); },
      [&] { store_->changes("x", 0); },
      [&] { store_->scans("x", "drive"); },
  };
  for (const auto& verb : verbs) expect_error(ErrorCode::kNotFound, verb, "no map");
}

TEST_P(StoreContract, NamesAreValuesAndNeverSql) {
  store_->create_map("town", {});
  const std::string evil = "x' OR '1'='1";
  expect_error(
      ErrorCode::kNotFound, [&] { store_->map(evil); }, "no map");
  expect_error(
      ErrorCode::kNotFound, [&] { store_->delete_map(evil); }, "no map");
  EXPECT_FALSE(store_->last_cell("town", "a'; DROP TABLE cell; --"));
  EXPECT_EQ(store_->maps().size(), 1u);
}

TEST_P(StoreContract, TheSummaryCountsWhatTheMapHolds) {
  store_->create_map("town", {});
  MapUpdate update =
      adding({make_cell(1, pose_at(-5, 2, 1)), make_cell(2, pose_at(7, -3, 4), "other")});
  update.add_constraints = {make_constraint(1, 2)};
  update.cells[0].voxel_points = 70;
  update.cells[1].voxel_points = 7;
  store_->commit("town", update);
  const MapInfo map = store_->map("town");
  EXPECT_EQ(map.revision, 1u);
  EXPECT_EQ(map.cells, 2u);
  EXPECT_EQ(map.planes, 6u);
  EXPECT_EQ(map.constraints, 1u);
  EXPECT_EQ(map.encoded_bytes, 400u);
  EXPECT_EQ(map.stored_bytes, store_->compressed_cell("town", {1})->size() +
                                  store_->compressed_cell("town", {2})->size());
  EXPECT_EQ(map.scans, 4u);
  EXPECT_EQ(map.raw_points, 2000u);
  EXPECT_EQ(map.voxel_points, 77u);
  EXPECT_EQ(map.bounds.min(), Eigen::Vector3d(-5, -3, 1));
  EXPECT_EQ(map.bounds.max(), Eigen::Vector3d(7, 2, 4));
  EXPECT_THAT(map.sessions, ElementsAre("drive", "other"));
}

TEST_P(StoreContract, ADeletedMapIsGoneAndItsNameIsFree) {
  store_->create_map("town", {});
  MapUpdate update = adding({make_cell(1), make_cell(2)});
  update.add_constraints = {make_constraint(1, 2)};
  store_->commit("town", update);
  store_->delete_map("town");
  expect_error(
      ErrorCode::kNotFound, [&] { store_->map("town"); }, "no map");
  store_->create_map("town", {});
  EXPECT_EQ(store_->map("town").revision, 0u);
  EXPECT_TRUE(store_->cells("town", {}).cells.empty());
  EXPECT_TRUE(store_->pose_graph("town").constraints.empty());
  expect_error(
      ErrorCode::kNotFound, [&] { store_->compressed_cell("town", {1}); }, "CELL 1");
}

TEST_P(StoreContract, DeletingAMapKeepsWhatAnotherMapShares) {
  for (const char* map : {"a", "b"}) {
    store_->create_map(map, {});
    store_->commit(map, adding({make_cell(1)}));
  }
  store_->delete_map("a");
  reopen();  // nothing comes from a cache
  EXPECT_EQ(zstd_decompress(*store_->compressed_cell("b", {1}), 1000), make_cell(1).encoded.bytes);
}

TEST_P(StoreContract, EverythingIsThereAfterReopening) {
  store_->create_map("town", {});
  MapUpdate update = adding({make_cell(1), make_cell(2, pose_at(1, 2, 3, 0.5))});
  update.add_constraints = {make_constraint(1, 2)};
  store_->commit("town", update);
  store_->commit("town", moving({{{2}, pose_at(4, 5, 6, 0.7)}}));
  reopen();
  EXPECT_EQ(store_->map("town").revision, 2u);
  EXPECT_EQ(store_->cell("town", {2}).T_map_cell.matrix(), pose_at(4, 5, 6, 0.7).matrix());
  EXPECT_EQ(store_->pose_graph("town", 1).nodes.at({2}).matrix(), pose_at(1, 2, 3, 0.5).matrix());
  EXPECT_EQ(store_->pose_graph("town").constraints.size(), 1u);
}

}  // namespace
}  // namespace cellmap::test
