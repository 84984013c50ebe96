#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kGeoreference = "/v1/maps/town/georeference";

/// The CELL of one scan of the street, dense enough to be found without a prior.
EncodedCell dense_cell(std::uint32_t sequence, double x_m, const std::string& session) {
  static const auto kScene = cellmap::test::street();
  cellmap::test::BoxScene::Sensor sensor;
  sensor.beams = 64;
  sensor.azimuths = 1200;
  const Pose T_odom_sensor = level_pose(x_m, 0, 0);
  const LocalMap local_map(filter_scan(kScene.scan(T_odom_sensor, sensor), sequence, {}),
                           T_odom_sensor, sequence);
  Cell cell = build_cell(local_map, Lattice({LatticeKind::kFibonacci, 20'000}), {});
  cell.session = session;
  cell.sequence = sequence;
  return encode_cell(cell);
}

/// Two maps of one street, each of a drive of its own: town at x = 0, 6, 12, 18; east at 3, 9, 15.
class ApiMerge : public ApiTest {
 protected:
  ApiMerge() {
    for (const char* const name : {"town", "east"}) make_dense_map(name);
    for (std::uint32_t i = 0; i < 4; ++i) drive("town", dense_cell(i, 6.0 * i, "monday"), "monday");
    for (std::uint32_t i = 0; i < 3; ++i) {
      drive("east", dense_cell(i, 6.0 * i + 3, "tuesday"), "tuesday");
    }
  }

  void make_dense_map(const std::string& name) {
    const auto made = post(
        "/v1/maps", R"({"name":")" + name + R"(","lattice":{"kind":"fibonacci","size":20000}})");
    ASSERT_EQ(made.status, 201) << body_view(made);
  }
  void drive(const std::string& map, const EncodedCell& cell, const std::string& session) {
    const auto put =
        send("PUT", "/v1/maps/" + map + "/sessions/" + session + "/cells/" + to_hex(cell.hash),
             to_text(cell.bytes), {{"Content-Type", "application/vnd.cellmap.cell"}});
    ASSERT_EQ(put.status, 201) << body_view(put);
  }
  Response merge(const std::string& body) { return post("/v1/maps/town/merge", body); }
  Response split(const std::string& body) { return post("/v1/maps/town/split", body); }
  Json map(const std::string& name) { return json_of(get("/v1/maps/" + name)); }
  Json graph(const std::string& name) {
    return json_of(get("/v1/maps/" + name + "/pose-graph", {{"Accept", "application/json"}}));
  }
  Json session(const std::string& name) { return json_of(get("/v1/maps/town/sessions/" + name)); }
};

TEST_F(ApiMerge, BringsTheSessionsOfAnotherMapAndJoinsThem) {
  const Json before = map("east");
  const auto asked = merge(R"({"from":"east"})");
  ASSERT_EQ(asked.status, 202) << body_view(asked);
  const Json job = json_of(asked);
  EXPECT_EQ(job["kind"], "merge");
  const Json ended = ended_job(job);
  ASSERT_EQ(ended["state"], "succeeded") << ended.dump();
  EXPECT_EQ(ended["cells_done"], 3);
  EXPECT_EQ(json_of(get("/v1/jobs/" + job["id"].dump()))["session"], Json());

  EXPECT_EQ(session("tuesday")["cells"], 3);
  EXPECT_EQ(session("tuesday")["aligned"], true);
  const Json merged = graph("town");
  ASSERT_EQ(merged["nodes"].size(), 7u);
  for (std::size_t i = 0; i < 3;
       ++i) {  // where the street says, though their map knew nothing of it
    EXPECT_NEAR(merged["nodes"][4 + i]["pose"][0], 6.0 * static_cast<double>(i) + 3, 0.1);
    EXPECT_NEAR(merged["nodes"][4 + i]["pose"][1], 0, 0.1);
  }
  EXPECT_EQ(map("east"), before);
  EXPECT_EQ(json_of(get("/v1/maps/east/cells"))["cells"][0]["hash"],
            json_of(get("/v1/maps/town/cells?session=tuesday"))["cells"][0]["hash"]);

  const std::size_t constraints = merged["constraints"].size();
  EXPECT_EQ(ended_job(json_of(merge(R"({"from":"east"})")))["state"], "succeeded");
  EXPECT_EQ(graph("town")["constraints"].size(), constraints) << "nothing twice";
}

TEST_F(ApiMerge, IntoAnEmptyMapIsACopy) {
  make_dense_map("copy");
  const auto asked = post("/v1/maps/copy/merge", R"({"from":"town","sessions":["monday"]})");
  ASSERT_EQ(ended_job(json_of(asked))["state"], "succeeded");
  const Json copy = graph("copy"), town = graph("town");
  EXPECT_EQ(copy["nodes"], town["nodes"]);
  EXPECT_EQ(copy["constraints"], town["constraints"]);
  EXPECT_TRUE(copy["unaligned"].empty());
}

TEST_F(ApiMerge, TwoSessionsOfOneNameAreAConflict) {
  make_dense_map("west");
  drive("west", dense_cell(0, 1, "monday"), "monday");
  const Json ended = ended_job(json_of(merge(R"({"from":"west"})")));
  EXPECT_EQ(ended["state"], "failed");
  EXPECT_EQ(ended["error"]["code"], "conflict");
  EXPECT_EQ(map("town")["cells"], 4);
}

TEST_F(ApiMerge, WhatCannotBeMergedIsRefused) {
  expect_problem(merge("{}"), 400, "invalid-argument");
  expect_problem(merge(R"({"from":"town"})"), 400, "invalid-argument");
  expect_problem(merge(R"({"from":"east","sessions":[]})"), 400, "invalid-argument");
  expect_problem(merge(R"({"from":"none"})"), 404, "not-found");
  expect_problem(post("/v1/maps/none/merge", R"({"from":"east"})"), 404, "not-found");
  expect_problem(send("POST", "/v1/maps/town/merge", "{}", {{"Content-Type", "text/plain"}}), 415,
                 "unsupported");
  const Json ended = ended_job(json_of(merge(R"({"from":"east","sessions":["friday"]})")));
  EXPECT_EQ(ended["error"]["code"], "not-found");
  post("/v1/maps", R"({"name":"fine","lattice":{"kind":"fibonacci","size":7000}})");
  EXPECT_EQ(ended_job(json_of(merge(R"({"from":"fine"})")))["error"]["code"], "invalid-argument");
}

TEST_F(ApiMerge, ASplitMovesASessionWithItsPosesIntoAMapOfItsOwn) {
  ASSERT_EQ(ended_job(json_of(merge(R"({"from":"east"})")))["state"], "succeeded");
  const Json before = graph("town");
  const auto divided = split(R"({"sessions":["tuesday"],"into":"basement"})");
  ASSERT_EQ(divided.status, 201) << body_view(divided);
  EXPECT_EQ(divided.headers.get("Location"), "/v1/maps/basement");
  EXPECT_EQ(json_of(divided)["cells"], 3);
  EXPECT_EQ(map("town")["cells"], 4);
  EXPECT_EQ(map("town")["sessions"], Json({"monday"}));
  const Json moved = graph("basement");
  ASSERT_EQ(moved["nodes"].size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(moved["nodes"][i]["pose"], before["nodes"][4 + i]["pose"]);
  }
  EXPECT_EQ(moved["constraints"].size(), 2u) << "between neighbours";
  // The next CELL gets a number that nobody has ever seen.
  drive("town", dense_cell(0, 2, "wednesday"), "wednesday");
  EXPECT_EQ(graph("town")["nodes"][4]["id"], 8);
}

TEST_F(ApiMerge, WhatCannotBeSplitIsRefusedAndLeavesNothing) {
  expect_problem(split(R"({"sessions":["monday"]})"), 400, "invalid-argument");
  expect_problem(split(R"({"sessions":["friday"],"into":"new"})"), 404, "not-found");
  expect_problem(get("/v1/maps/new"), 404, "not-found");
  expect_problem(split(R"({"sessions":["monday"],"into":"east"})"), 409, "already-exists");
  expect_problem(send("POST", "/v1/maps/town/split", "{}", {{"Content-Type", "text/plain"}}), 415,
                 "unsupported");
  EXPECT_EQ(map("town")["cells"], 4);
}

TEST_F(ApiMerge, ASessionIsDeletedButNotUnderAJob) {
  const std::string one = "/v1/maps/town/sessions/monday";
  const auto job =
      json_of(post("/v1/maps/town/jobs", R"({"kind":"ingest","session":"live","upload":true})"));
  expect_problem(send("DELETE", one), 409, "conflict");
  expect_problem(split(R"({"sessions":["monday"],"into":"new"})"), 409, "conflict");
  send("DELETE", "/v1/jobs/" + job["id"].dump());
  ended_job(job);
  const auto changes = "/v1/maps/town/changes?since=" + map("town")["revision"].dump();
  EXPECT_EQ(send("DELETE", one).status, 204);
  EXPECT_EQ(map("town")["cells"], 0);
  expect_problem(send("DELETE", one), 404, "not-found");
  expect_problem(get(changes), 404, "not-found");
}

TEST_F(ApiMerge, AMapIsPlacedOnEarthAndAnswersInGeoPoses) {
  expect_problem(get(kGeoreference), 404, "not-found");
  const auto put = [&](const std::string& body) {
    return send("PUT", kGeoreference, body, {{"Content-Type", "application/json"}});
  };
  // The map's x axis points north.
  const Json placed = json_of(put(
      R"({"latitude_deg":49,"longitude_deg":8,"height_m":100,"q_enu_map":[0,0,0.7071067811865476,0.7071067811865476]})"));
  EXPECT_EQ(placed["latitude_deg"], 49.0);
  EXPECT_EQ(json_of(get(kGeoreference)), placed);
  EXPECT_EQ(map("town")["georeference"], placed);

  const auto answer =
      send("POST", "/v1/maps/town/relocalise", to_text(dense_cell(0, 9, "other").bytes),
           {{"Content-Type", "application/vnd.cellmap.cell"}});
  ASSERT_EQ(answer.status, 200) << body_view(answer);
  const Json json = json_of(answer);
  ASSERT_EQ(json["found"], true) << body_view(answer);
  EXPECT_NEAR(json["T_map_scan"][0], 9, 0.1);
  EXPECT_GE(json["confidence"], 0.5);
  // A degree of latitude is 111.2 km there.
  EXPECT_NEAR(json["geopose"]["position"]["lat"], 49 + 9 / 111'207.0, 1e-6);
  EXPECT_NEAR(json["geopose"]["position"]["lon"], 8, 2e-6);
  EXPECT_NEAR(json["geopose"]["quaternion"]["z"], std::sqrt(0.5), 0.01);

  expect_problem(put("{}"), 400, "invalid-argument");
  expect_problem(put(R"({"latitude_deg":99,"longitude_deg":8,"height_m":1,"q_enu_map":[0,0,0,1]})"),
                 400, "invalid-argument");
  expect_problem(send("PUT", kGeoreference, "{}", {{"Content-Type", "text/plain"}}), 415,
                 "unsupported");
  expect_problem(send("PUT", "/v1/maps/none/georeference",
                      R"({"latitude_deg":9,"longitude_deg":8,"height_m":1,"q_enu_map":[0,0,0,1]})",
                      {{"Content-Type", "application/json"}}),
                 404, "not-found");
  EXPECT_EQ(send("DELETE", kGeoreference).status, 204);
  EXPECT_TRUE(map("town")["georeference"].is_null());
  expect_problem(send("DELETE", "/v1/maps/none/georeference"), 404, "not-found");
}

}  // namespace
}  // namespace cellmap::server::test
