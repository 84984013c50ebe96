#include "server/api/place_parts.hpp"

#include <SQLiteCpp/SQLiteCpp.h>

#include <thread>

#include "cellmap/store/descriptions.hpp"
#include "cellmap/store/read_cell.hpp"
#include "server/server_fixture.hpp"
#include "support/expect_error.hpp"

namespace cellmap::server::test {
namespace {

constexpr double kFarM = 3000;

/// CELLs 1 to 4 of the street where they are, and from 5 on the same places again far away.
class PlacePartsTest : public ApiTest {
 protected:
  PlacePartsTest() {
    make_map();
    put_street(4);
    for (std::uint32_t i = 0; i < 4; ++i) {
      EXPECT_EQ(put_cell(5 + i, street_cell(i, 6 * i, "again")).status, 201);
    }
    MapUpdate update;
    for (const auto& [id, pose] : store_->pose_graph("town").nodes) {
      if (id.value > 4) update.poses[id] = level_pose(kFarM + pose.translation().x(), 0, 0);
    }
    store_->commit("town", update);
  }

  PlaceRegions regions() const { return PlaceRegions(store_->pose_graph("town")); }
  DescribedCells described() {
    return {*store_, cache_, "town", std::make_shared<const Lattice>(kLattice)};
  }
  void move(CellId id, const Pose& T) {
    MapUpdate update;
    update.poses[id] = T;
    store_->commit("town", update);
  }

  void damage_the_cells_far_away() {
    SQLite::Database db((folder_.path() / "store.db").string(), SQLite::OPEN_READWRITE);
    SQLite::Statement update(db,
                             "UPDATE blob SET frame = x'00' WHERE hash IN "
                             "(SELECT hash FROM cell WHERE session = 'again')");
    ASSERT_EQ(update.exec(), 4);
  }

  Json relocalise(const std::string& query, const PointCloud& scan) {
    const auto response = send("POST", "/v1/maps/town/relocalise" + query, kitti_bytes(scan),
                               {{"Content-Type", "application/octet-stream"}});
    EXPECT_EQ(response.status, 200) << body_view(response);
    return json_of(response);
  }
  static PointCloud scan_at(double x, double y, double yaw_deg) {
    cellmap::test::BoxScene::Sensor sensor;
    sensor.beams = 24;
    sensor.azimuths = 300;
    return cellmap::test::street().scan(level_pose(x, y, yaw_deg), sensor);
  }

  PartCache cache_{std::size_t{1} << 30};
};

TEST_F(PlacePartsTest, APartHasTheCellsOfItsRegionAndIsAtHandFromThenOn) {
  DescribedCells cells = described();
  const PlaceRegions all = regions();
  ASSERT_EQ(all.all().size(), 2u);
  const auto& [near, far] = std::tie(all.all()[0], all.all()[1]);
  EXPECT_FALSE(cells.is_at_hand(near.key));
  const auto part = cells.part(near);
  EXPECT_EQ(part->ids(), near.ids);
  EXPECT_TRUE(cells.is_at_hand(near.key));
  EXPECT_FALSE(cells.is_at_hand(far.key));
  EXPECT_EQ(cells.part(near), part);  // not made again
  const auto expected = describe_place(
      reconstruct_points(read_cell(*store_, "town", near.ids[2]), Lattice(kLattice)));
  const DescribedPlace& made = *part->find(near.ids[2]);
  EXPECT_EQ(made.T_ground_cell.matrix(), expected.T_ground_cell.matrix());
  EXPECT_EQ(made.signature.expanded().cosine(), expected.signature.expanded().cosine());
}

TEST_F(PlacePartsTest, WhatWasDescribedOnceIsReadFromTheStoreFromThenOn) {
  const PlaceRegions all = regions();
  const auto& far = all.all()[1];
  const auto made = described().part(far);
  damage_the_cells_far_away();  // nobody looks at them again
  start();
  const auto read = described().part(far);
  ASSERT_EQ(read->ids(), far.ids);
  for (const CellId id : far.ids) {
    EXPECT_EQ(to_bytes(*read->find(id)), to_bytes(*made->find(id))) << id.value;
  }
  // In a form that this program does not know, it is no description.
  auto bytes = to_bytes(*made->find(far.ids[0]));
  bytes[0] = std::byte{99};
  descriptions_of(*store_).keep_descriptions(
      "town", {{far.ids[0], store_->cell("town", far.ids[0]).hash, bytes}});
  cellmap::test::expect_error(ErrorCode::kCorruptData, [&] { described().part(far); });
}

TEST_F(PlacePartsTest, WhatWasDamagedInTheStoreIsDescribedAnew) {
  const PlaceRegions all = regions();
  const auto& near = all.all()[0];
  const auto made = described().part(near);
  {
    SQLite::Database db((folder_.path() / "store.db").string(), SQLite::OPEN_READWRITE);
    SQLite::Statement update(
        db, "UPDATE cell_description SET bytes = x'01' || zeroblob(length(bytes) - 1)");
    ASSERT_EQ(update.exec(), 4);
  }
  start();
  for (int time = 0; time < 2; ++time) {  // the second time it is there again
    const auto again = described().part(near);
    for (const CellId id : near.ids) {
      EXPECT_EQ(to_bytes(*again->find(id)), to_bytes(*made->find(id))) << id.value;
    }
  }
  const auto kept = descriptions_of(*store_).descriptions("town", near.ids);
  ASSERT_EQ(kept.size(), near.ids.size());
  EXPECT_EQ(kept[0].bytes, to_bytes(*made->find(near.ids[0])));
}

TEST_F(PlacePartsTest, ACellThatMovesIsFoundInItsNewRegion) {
  DescribedCells cells = described();
  const PlaceRegions before = regions();
  for (const auto& region : before.all()) cells.part(region);
  move({4}, level_pose(kFarM + 30, 0, 0));
  const PlaceRegions after = regions();
  const auto& far = *after.find({static_cast<int>(kFarM / kRegionSideM), 0});
  EXPECT_EQ(far.ids.front(), CellId{4});
  EXPECT_NE(cells.part(far)->find({4}), nullptr);
  for (const CellId id : far.ids) EXPECT_NE(cells.part(far)->find(id), nullptr);

  const std::string prior = "?prior=" + std::to_string(kFarM + 30) + ",0,0,0,0,0,1&radius=3";
  const Json found = relocalise(prior, scan_at(18.3, 0.2, 0));  // beside where CELL 4 was built
  ASSERT_TRUE(found["found"]) << found.dump();
  EXPECT_NEAR(found["T_map_scan"][0], kFarM + 30.3, 0.2);
}

TEST_F(PlacePartsTest, CellsThatLeftDoNotOutgrowThoseThatAreThere) {
  DescribedCells cells = described();
  const PlaceRegions before = regions();
  const RegionKey here = before.all()[0].key;
  cells.part(*before.find(here));
  for (const std::uint32_t id : {1u, 2u, 3u}) move({id}, level_pose(kFarM, 100.0 + id, 0));
  move({8}, level_pose(10, 10, 0));
  move({4}, level_pose(kFarM, 120, 0));
  const PlaceRegions after = regions();
  EXPECT_EQ(cells.part(*after.find(here))->ids(), (std::vector<CellId>{{8}}));
}

/// The bytes of a CELL far away cannot be read: nobody notices who knows where he is.
TEST_F(PlacePartsTest, WithAPriorOnlyTheRegionsWithinReachAreRead) {
  damage_the_cells_far_away();
  start();
  const Json found = relocalise("?prior=8,0,0,0,0,0,1&radius=3", scan_at(8.2, 0.4, 4));
  EXPECT_TRUE(found["found"]) << found.dump();
  const auto anywhere = send("POST", "/v1/maps/town/relocalise", kitti_bytes(scan_at(8.2, 0.4, 4)),
                             {{"Content-Type", "application/octet-stream"}});
  expect_problem(anywhere, 422, "corrupt-data");
}

TEST_F(PlacePartsTest, AnswersDoNotDependOnTheMemoryThatPartsMayTake) {
  const auto ask = [&] {
    Json answers = Json::array();
    for (const std::string query : {"", "?prior=9,0,0,0,0,0,1&radius=3"}) {
      for (const double x : {3.0, 8.2, 14.0}) {
        Json answer = relocalise(query, scan_at(x, 0.3, 5));
        answer.erase("time_ms");
        answers.push_back(std::move(answer));
      }
    }
    return answers;
  };
  const Json with_room = ask();
  auto narrow = options();
  narrow.maps.place_bytes = 1;
  start(std::move(narrow));
  EXPECT_EQ(ask(), with_room);
}

/// While CELLs move to and fro, whoever asks gets what the graph at hand says.
TEST_F(PlacePartsTest, ReadersAreNotDisturbedByPartsThatAreMadeAnew) {
  DescribedCells cells = described();
  const PlaceRegions before = regions();
  move({4}, level_pose(kFarM + 30, 0, 0));
  const PlaceRegions after = regions();
  const auto read = [&cells](const PlaceRegions& of) {
    for (int i = 0; i < 40; ++i) {
      for (const auto& region : of.all()) {
        const auto part = cells.part(region);
        for (const CellId id : region.ids) ASSERT_NE(part->find(id), nullptr);
      }
    }
  };
  std::jthread one([&] { read(before); }), other([&] { read(after); });
}

}  // namespace
}  // namespace cellmap::server::test
