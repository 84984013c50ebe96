#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kSessions = "/v1/maps/town/sessions";

class ApiSessions : public ApiTest {
 protected:
  ApiSessions() { make_map(); }

  Response put(const EncodedCell& cell, const std::string& session = "drive",
               std::string hash = {}) {
    if (hash.empty()) hash = to_hex(cell.hash);
    return send("PUT", std::string(kSessions) + "/" + session + "/cells/" + hash,
                to_text(cell.bytes), {{"Content-Type", "application/vnd.cellmap.cell"}});
  }
  Json session(const std::string& name) {
    return json_of(get(std::string(kSessions) + "/" + name));
  }
  Json graph() {
    return json_of(get("/v1/maps/town/pose-graph", {{"Accept", "application/json"}}));
  }
  Json found_near_origin(const std::string& more = "") {
    return json_of(get("/v1/maps/town/cells?near=0,0,0&radius=100" + more))["cells"];
  }
};

TEST_F(ApiSessions, SayWhoDrives) {
  const std::string body =
      R"({"name":"monday","robot":"cart-7","sensor":"OS1-64","odometry_frame":"cart-7/odom","started_ns":1700000000000000000})";
  const auto made = post(kSessions, body);
  ASSERT_EQ(made.status, 201) << body_view(made);
  EXPECT_EQ(made.headers.get("Location"), "/v1/maps/town/sessions/monday");
  EXPECT_EQ(post(kSessions, body).status, 201);
  const Json json = session("monday");
  EXPECT_EQ(json["robot"], "cart-7");
  EXPECT_EQ(json["started"], "2023-11-14T22:13:20.000Z");
  EXPECT_EQ(json["cells"], 0);
  EXPECT_EQ(json["aligned"], false);
  EXPECT_TRUE(json["T_map_odom"].is_null());
  EXPECT_EQ(json_of(get(kSessions))["sessions"].size(), 1u);
  expect_problem(post(kSessions, R"({"name":"monday","robot":"cart-8"})"), 409, "already-exists");
}

TEST_F(ApiSessions, MalformedOnesAreRefused) {
  for (const char* const body :
       {"{}", R"({"name":"a b"})", R"({"name":""})", R"({"name":"a","robot":"\u0001"})",
        R"({"name":"a","colour":"red"})", R"({"name":"a","started_ns":-1})"}) {
    expect_problem(post(kSessions, body), 400, "invalid-argument");
  }
  expect_problem(get(std::string(kSessions) + "/tuesday"), 404, "not-found");
  expect_problem(get("/v1/maps/nowhere/sessions"), 404, "not-found");
}

TEST_F(ApiSessions, CellsComeInOrderAndAreTiedToOneAnother) {
  const EncodedCell first = street_cell(0, 0), second = street_cell(1, 6);
  expect_problem(put(second), 409, "conflict");
  const auto put_first = put(first);
  ASSERT_EQ(put_first.status, 201) << body_view(put_first);
  EXPECT_EQ(json_of(put_first)["aligned"], true);
  ASSERT_EQ(put(second).status, 201);
  EXPECT_EQ(put(first).status, 200);
  EXPECT_EQ(put(second).status, 200);
  const Json constraints = graph()["constraints"];
  ASSERT_EQ(constraints.size(), 1u);
  EXPECT_NEAR(constraints[0]["pose"][0], 6.0, 0.1);  // the street was driven straight on
  expect_problem(put(street_cell(1, 7)), 409, "conflict");
  EXPECT_EQ(session("drive")["cells"], 2);
}

TEST_F(ApiSessions, ACellThatIsNotWhatThePathSaysIsRefused) {
  const EncodedCell cell = street_cell(0, 0);
  expect_problem(put(cell, "other"), 400, "invalid-argument");
  expect_problem(put(cell, "drive", std::string(64, '0')), 400, "invalid-argument");
  EncodedCell damaged = cell;
  damaged.bytes[damaged.bytes.size() / 2] ^= std::byte{1};
  expect_problem(put(damaged), 422, "corrupt-data");
  EXPECT_TRUE(graph()["nodes"].empty());
}

TEST_F(ApiSessions, ARobotAsksWhatIsLacking) {
  const EncodedCell first = street_cell(0, 0), second = street_cell(1, 6);
  put(first);
  const auto answer =
      post(std::string(kSessions) + "/drive/cells:lacking",
           R"({"hashes":[")" + to_hex(second.hash) + R"(",")" + to_hex(first.hash) + R"("]})");
  ASSERT_EQ(answer.status, 200) << body_view(answer);
  EXPECT_EQ(json_of(answer)["lacking"], Json({to_hex(second.hash)}));
  expect_problem(post(std::string(kSessions) + "/drive/cells:lacking", R"({"hashes":[1]})"), 400,
                 "invalid-argument");
}

TEST_F(ApiSessions, ASecondSessionIsAnIslandUntilItIsTiedToTheMap) {
  put(street_cell(0, 0, "first"), "first");
  const auto put_second = put(street_cell(0, 3, "second"), "second");
  ASSERT_EQ(put_second.status, 201) << body_view(put_second);
  EXPECT_EQ(json_of(put_second)["aligned"], false);
  EXPECT_EQ(session("second")["aligned"], false);
  EXPECT_TRUE(session("second")["T_map_odom"].is_null());
  EXPECT_EQ(graph()["unaligned"], Json({2}));
  EXPECT_EQ(json_of(get("/v1/maps/town/changes"))["unaligned"], Json({2}));
  EXPECT_EQ(found_near_origin().size(), 1u);
  EXPECT_EQ(found_near_origin("&session=second").size(), 1u);

  // Its odometry says x = 3; whoever knows better says that it stood at (3, 5), looking to the
  // left.
  const auto tied =
      post("/v1/maps/town/loops",
           R"({"from":1,"to":2,"pose":[3,5,0,0,0,0.7071067811865476,0.7071067811865476]})");
  ASSERT_EQ(tied.status, 201) << body_view(tied);
  EXPECT_TRUE(graph()["unaligned"].empty());
  EXPECT_EQ(session("second")["aligned"], true);
  const Json pose = graph()["nodes"][1]["pose"];
  EXPECT_NEAR(pose[0], 3, 1e-6);
  EXPECT_NEAR(pose[1], 5, 1e-6);
  EXPECT_NEAR(session("second")["T_map_odom"][1], 2, 1e-6);  // (3, 0) turned left is (0, 3)
  EXPECT_EQ(found_near_origin().size(), 2u);
  // What was is still told as it was.
  EXPECT_EQ(json_of(get("/v1/maps/town/pose-graph?revision=2",
                        {{"Accept", "application/json"}}))["unaligned"],
            Json({2}));
}

TEST_F(ApiSessions, NeedAMapAndTheRightContentType) {
  const std::string nowhere = "/v1/maps/nowhere/sessions";
  const EncodedCell cell = street_cell(0, 0);
  const std::string of_cell = "/drive/cells/" + to_hex(cell.hash);
  const std::vector<Headed> cell_type{{"Content-Type", "application/vnd.cellmap.cell"}};
  expect_problem(post(nowhere, R"({"name":"monday"})"), 404, "not-found");
  expect_problem(post(nowhere + "/drive/cells:lacking", R"({"hashes":[]})"), 404, "not-found");
  expect_problem(send("PUT", nowhere + of_cell, to_text(cell.bytes), cell_type), 404, "not-found");
  const std::vector<Headed> text{{"Content-Type", "text/plain"}};
  const std::string here = kSessions;
  expect_problem(send("POST", here, "{}", text), 415, "unsupported");
  expect_problem(send("POST", here + "/drive/cells:lacking", "{}", text), 415, "unsupported");
  expect_problem(send("PUT", here + of_cell, to_text(cell.bytes), text), 415, "unsupported");
}

TEST_F(ApiSessions, AreThereAfterARestart) {
  post(kSessions, R"({"name":"monday","robot":"cart-7"})");
  put(street_cell(0, 0, "first"), "first");
  put(street_cell(0, 3, "second"), "second");
  start();
  EXPECT_EQ(session("monday")["robot"], "cart-7");
  EXPECT_EQ(graph()["unaligned"], Json({2}));
  EXPECT_EQ(json_of(put(street_cell(1, 9, "second"), "second"))["aligned"], false);
}

}  // namespace
}  // namespace cellmap::server::test
