#include "server/server_fixture.hpp"
#include "support/two_days.hpp"

namespace cellmap::server::test {
namespace {

using cellmap::test::is_on;
using cellmap::test::kParkedCar;
using cellmap::test::street_with;

Eigen::Vector3d point_of(const Json& json) {
  return {json[0].get<double>(), json[1].get<double>(), json[2].get<double>()};
}

/// On Monday a car was parked in the street, on Tuesday it is gone. CELLs 1 and 2, 3 and 4.
class ApiDiff : public ApiTest {
 protected:
  ApiDiff() {
    make_map();
    for (std::uint32_t i = 0; i < 2; ++i) {
      put(i + 1, "monday", i, street_with({kParkedCar}), 6.0 * i);
      put(i + 3, "tuesday", i, cellmap::test::street(), 6.0 * i + 2);
    }
  }

  void put(std::uint32_t id, const std::string& session, std::uint32_t sequence,
           const cellmap::test::BoxScene& scene, double x) {
    const Lattice lattice(kLattice);
    Cell cell = cellmap::test::cell_seen(scene, level_pose(x, 0, 0), lattice, id);
    cell.session = session;
    cell.sequence = sequence;
    const auto response = put_cell(id, encode_cell(cell));
    ASSERT_EQ(response.status, 201) << body_view(response);
  }
  Response diff(const std::string& query) { return get("/v1/maps/town/diff" + query); }
};

TEST_F(ApiDiff, TellsWhatIsGoneAndWhere) {
  const auto response = diff("?sessions=monday,tuesday");
  ASSERT_EQ(response.status, 200) << body_view(response);
  const Json json = json_of(response);
  EXPECT_EQ(json["sessions"], Json({"monday", "tuesday"}));
  EXPECT_EQ(json["revision"], 4);
  EXPECT_EQ(json["pairs"], 4);
  ASSERT_EQ(json["regions"].size(), 1u);
  const Json& region = json["regions"][0];
  EXPECT_EQ(region["change"], "vanished");
  const Json& at = region["centroid"];
  EXPECT_TRUE(is_on(kParkedCar, point_of(at), 0.1)) << at;
  EXPECT_EQ(region["cells"], Json({1, 2}));
  ASSERT_EQ(json["cells"].size(), 4u);
  EXPECT_EQ(json["cells"][0]["id"], 1);
  EXPECT_EQ(json["cells"][0]["session"], "monday");
  EXPECT_GT(json["cells"][0]["vanished"], 5);
  EXPECT_GT(json["cells"][0]["stayed"], 500);
  EXPECT_EQ(json["cells"][2]["vanished"], 0);
  EXPECT_EQ(json["cells"][2]["appeared"], 0);
  EXPECT_FALSE(json["cells"][0].contains("changed"));
}

TEST_F(ApiDiff, TheOtherWayRoundItAppeared) {
  const Json json = json_of(diff("?sessions=tuesday,monday"));
  ASSERT_EQ(json["regions"].size(), 1u);
  EXPECT_EQ(json["regions"][0]["change"], "appeared");
  EXPECT_EQ(json["cells"][0]["session"], "tuesday");
}

TEST_F(ApiDiff, NamesThePatchesWhereTheyAreAskedFor) {
  const Json json = json_of(diff("?sessions=monday,tuesday&patches=true"));
  for (const Json& cell : json["cells"]) {
    EXPECT_EQ(cell["changed"].size(), cell["vanished"].get<std::size_t>());
    for (const Json& index : cell["changed"]) EXPECT_LT(index, kLattice.size);
  }
}

TEST_F(ApiDiff, APartOfTheMapIsComparedAlone) {
  const Json near = json_of(diff("?sessions=monday,tuesday&near=0,0,0&radius=3"));
  EXPECT_EQ(near["pairs"], 1);
  EXPECT_EQ(near["cells"].size(), 2u);
  const Json far = json_of(diff("?sessions=monday,tuesday&near=500,0,0&radius=3"));
  EXPECT_EQ(far["pairs"], 0);
  EXPECT_TRUE(far["cells"].empty());
}

TEST_F(ApiDiff, RefusesWhatItCannotCompare) {
  for (const char* const query :
       {"", "?sessions=monday", "?sessions=monday,monday", "?sessions=a,b,c",
        "?sessions=monday,tuesday&near=1,2,3", "?sessions=monday,tuesday&near=1,2&radius=3",
        "?sessions=monday,tuesday&near=1,2,3&radius=0", "?sessions=monday,tuesday&patches=yes",
        "?sessions=monday,tuesday&colour=red"}) {
    expect_problem(diff(query), 400, "invalid-argument");
  }
  expect_problem(diff("?sessions=monday,friday"), 404, "not-found");
  expect_problem(get("/v1/maps/nowhere/diff?sessions=monday,tuesday"), 404, "not-found");
}

TEST_F(ApiDiff, SessionsThatAreNotInTheMapFrameCannotBeCompared) {
  ASSERT_EQ(post("/v1/maps/town/sessions", R"({"name":"empty"})").status, 201);
  expect_problem(diff("?sessions=monday,empty"), 409, "conflict");
  const EncodedCell cell = street_cell(0, 3, "lost");
  ASSERT_EQ(send("PUT", "/v1/maps/town/sessions/lost/cells/" + to_hex(cell.hash),
                 to_text(cell.bytes), {{"Content-Type", "application/vnd.cellmap.cell"}})
                .status,
            201);
  ASSERT_EQ(json_of(get("/v1/maps/town/sessions/lost"))["aligned"], false);
  const std::string detail = expect_problem(diff("?sessions=monday,lost"), 409, "conflict");
  EXPECT_THAT(detail, ::testing::HasSubstr("/v1/maps/town/loops"));
}

TEST_F(ApiDiff, MoreThanOneRequestMayTakeIsRefusedWithAWayOut) {
  // Two drives of 1,000 CELLs a metre apart, each with the 5 nearest of the other.
  Cell cell = decode_cell(street_cell(0, 0).bytes);
  cell.indices.resize(1);
  cell.planes.resize(1);
  MapUpdate update;
  for (std::uint32_t i = 0; i < 2000; ++i) {
    cell.session = i % 2 == 0 ? "there" : "back";
    cell.sequence = i / 2;
    NewCell added;
    added.id = CellId{100 + i};
    added.cell = std::make_shared<const Cell>(cell);
    added.encoded = encode_cell(cell);
    added.T_map_cell = level_pose(1000 + 0.5 * i, 0, 0);
    update.cells.push_back(std::move(added));
  }
  store_->commit("town", update);
  const std::string detail = expect_problem(diff("?sessions=there,back"), 413, "too-large");
  EXPECT_THAT(detail, ::testing::HasSubstr("radius"));
  EXPECT_EQ(diff("?sessions=there,back&near=1000,0,0&radius=5").status, 200);
}

TEST_F(ApiDiff, TooManyAtATimeAreTurnedAway) {
  ApiOptions none = options();
  none.relocalisations = 0;
  none.relocalisation_wait = std::chrono::milliseconds(1);
  start(none);
  expect_problem(diff("?sessions=monday,tuesday"), 503, "unavailable");
}

}  // namespace
}  // namespace cellmap::server::test
