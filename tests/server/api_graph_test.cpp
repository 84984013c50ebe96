#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

using ::testing::Contains;

const Headed kAcceptJson{"Accept", "application/json"};
constexpr const char* kGraph = "/v1/maps/town/pose-graph";
constexpr const char* kLoops = "/v1/maps/town/loops";

class ApiGraph : public ApiTest {
 protected:
  ApiGraph() {
    make_map();
    put_street(3);  // CELLs 1, 2, 3 at x = 0, 6, 12; revision 3
  }

  double x_of(std::size_t node) {
    return json_of(get(kGraph, {kAcceptJson}))["nodes"][node]["pose"][0];
  }
  Response add_loop(int from, int to, double x) {
    return post(kLoops, R"({"from":)" + std::to_string(from) + R"(,"to":)" + std::to_string(to) +
                            R"(,"pose":[)" + std::to_string(x) + ",0,0,0,0,0,1]}");
  }
};

TEST_F(ApiGraph, BothFormsOfThePoseGraphAgree) {
  ASSERT_EQ(add_loop(1, 2, 6.5).status, 201);
  const auto binary = get(kGraph);
  EXPECT_EQ(binary.headers.get("Content-Type"), "application/vnd.cellmap.pose-graph");
  const PoseGraph graph = decode_pose_graph(as_bytes(body_view(binary)));
  const Json json = json_of(get(kGraph, {kAcceptJson}));
  EXPECT_EQ(graph.revision, json["revision"].get<Revision>());
  ASSERT_EQ(graph.nodes.size(), json["nodes"].size());
  ASSERT_EQ(graph.constraints.size(), json["constraints"].size());
  EXPECT_EQ(graph.nodes.at({2}).translation().x(), json["nodes"][1]["pose"][0].get<double>());
}

TEST_F(ApiGraph, ThePoseGraphIsCompressedForWhoAccepts) {
  ASSERT_EQ(add_loop(1, 2, 6.5).status, 201);
  const auto plain = get(kGraph), packed = get(kGraph, {{"Accept-Encoding", "zstd"}});
  EXPECT_EQ(packed.headers.get("Content-Encoding"), "zstd");
  EXPECT_EQ(to_text(zstd_decompress(as_bytes(body_view(packed)), 1 << 20)), body_view(plain));
  EXPECT_NE(packed.headers.get("ETag"), plain.headers.get("ETag"));
  EXPECT_EQ(packed.headers.get("Vary"), "Accept, Accept-Encoding");
  EXPECT_EQ(get(kGraph, {{"If-None-Match", *packed.headers.get("ETag")}}).status, 304);
}

TEST_F(ApiGraph, AnEarlierRevisionIsServedAsItWas) {
  ASSERT_EQ(add_loop(1, 2, 7).status, 201);
  const Json before = json_of(get(std::string(kGraph) + "?revision=3", {kAcceptJson}));
  EXPECT_EQ(before["revision"], 3);
  EXPECT_EQ(before["nodes"][1]["pose"][0], 6.0);
  EXPECT_TRUE(before["constraints"].empty());
  expect_problem(get(std::string(kGraph) + "?revision=99"), 404, "not-found");
  expect_problem(get(std::string(kGraph) + "?revision=x"), 400, "invalid-argument");
  expect_problem(get("/v1/maps/none/pose-graph"), 404, "not-found");
  expect_problem(get(kGraph, {{"Accept", "image/png"}}), 406, "not-acceptable");
}

TEST_F(ApiGraph, AnUnchangedPoseGraphIsNotSentAgain) {
  const auto tag = *get(kGraph).headers.get("ETag");
  EXPECT_EQ(tag, "\"r3\"");
  EXPECT_EQ(get(kGraph, {{"If-None-Match", tag}}).status, 304);
  EXPECT_EQ(get(kGraph, {{"If-None-Match", tag}, kAcceptJson}).status, 304);
  ASSERT_EQ(add_loop(1, 2, 7).status, 201);
  EXPECT_EQ(get(kGraph, {{"If-None-Match", tag}}).status, 200);
}

TEST_F(ApiGraph, ChangesTellWhatAClientLacks) {
  ASSERT_EQ(add_loop(1, 2, 7).status, 201);  // revision 4
  const Json changes = json_of(get("/v1/maps/town/changes?since=2"));
  EXPECT_EQ(changes["since"], 2);
  EXPECT_EQ(changes["revision"], 4);
  ASSERT_EQ(changes["added"].size(), 1u);
  EXPECT_EQ(changes["added"][0]["id"], 3);
  ASSERT_EQ(changes["moved"].size(), 1u);
  EXPECT_EQ(changes["moved"][0]["id"], 2);
  EXPECT_EQ(changes["added_constraints"].size(), 1u);
  EXPECT_TRUE(json_of(get("/v1/maps/town/changes?since=4"))["added"].empty());
  expect_problem(get("/v1/maps/town/changes?since=x"), 400, "invalid-argument");
  expect_problem(get("/v1/maps/none/changes"), 404, "not-found");
}

TEST_F(ApiGraph, AMeasuredLoopMovesItsCellAndDeletingAnotherMovesItBack) {
  const auto first = add_loop(1, 2, 7);
  ASSERT_EQ(first.status, 201) << body_view(first);
  EXPECT_EQ(json_of(first)["moved"], 1);
  EXPECT_EQ(json_of(first)["revision"], 4);
  EXPECT_NEAR(x_of(0), 0, 1e-9);  // the oldest holds the gauge
  EXPECT_NEAR(x_of(1), 7, 1e-6);

  const Json second = json_of(add_loop(1, 2, 7.1));
  EXPECT_NEAR(x_of(1), 7.05, 1e-3);  // two equally certain measurements meet in the middle
  const std::string id = second["loops"][0]["id"].dump();
  const auto gone = send("DELETE", std::string(kLoops) + "/" + id);
  EXPECT_EQ(gone.status, 200);
  EXPECT_EQ(json_of(gone)["moved"], 1);
  EXPECT_NEAR(x_of(1), 7, 1e-6);
  expect_problem(get(std::string(kLoops) + "/" + id), 404, "not-found");
  expect_problem(send("DELETE", std::string(kLoops) + "/" + id), 404, "not-found");
}

TEST_F(ApiGraph, LoopsAreListedAndShownAsPosted) {
  const auto made = add_loop(1, 3, 12.5);
  const Json loop = json_of(made)["loops"][0];
  EXPECT_EQ(loop["origin"], "user");
  EXPECT_EQ(loop["kind"], "loop");
  EXPECT_EQ(loop["pose"][0], 12.5);
  EXPECT_EQ(json_of(get(kLoops))["loops"][0], loop);
  const Json shown = json_of(get(std::string(*made.headers.get("Location"))));
  for (const auto& [key, value] : loop.items()) EXPECT_EQ(shown[key], value) << key;
  EXPECT_NEAR(shown["gap_m"], 0, 1e-6) << "nothing contradicts it";
  EXPECT_NEAR(shown["chi2"], 0, 1e-6);
  EXPECT_EQ(shown["verdict"], "accepted");
}

TEST_F(ApiGraph, ALoopThatTheOthersContradictIsRejectedExplainedAndMayBePinned) {
  for (int i = 0; i < 2; ++i) {
    ASSERT_EQ(add_loop(1, 2, 6 + 0.001 * i).status, 201);
    ASSERT_EQ(add_loop(2, 3, 6 + 0.001 * i).status, 201);
  }
  const auto made = add_loop(1, 3, 40);  // the others say 12 m
  const std::string path(*made.headers.get("Location"));
  EXPECT_EQ(json_of(made)["loops"][0]["verdict"], "rejected");
  const Json before = json_of(get(path));
  EXPECT_EQ(before["weight"], 0.0);
  EXPECT_NEAR(before["gap_m"], 28, 0.1);
  EXPECT_NEAR(x_of(2), 12, 0.1);

  const Json pinned = json_of(patch(path, R"({"pinned":true})"));
  EXPECT_EQ(pinned["verdict"], "pinned");
  EXPECT_EQ(pinned["weight"], 1.0);
  EXPECT_GE(pinned["moved"], 1);
  EXPECT_LT(pinned["gap_m"], 20) << "it counts now";
  const Json changes =
      json_of(get("/v1/maps/town/changes?since=" + before["revision"].dump(), {kAcceptJson}));
  EXPECT_THAT(changes["judged"],
              Contains(Json{{"id", before["id"]}, {"weight", 1.0}, {"pinned", true}}));

  const Json unpinned = json_of(patch(path, R"({"pinned":false})"));
  EXPECT_EQ(unpinned["verdict"], "rejected");
  EXPECT_NEAR(x_of(2), 12, 0.1);
}

TEST_F(ApiGraph, WrongPinsAreRefused) {
  ASSERT_EQ(add_loop(1, 3, 12.5).status, 201);
  const std::string one = std::string(kLoops) + "/1";
  expect_problem(patch(one, "{}"), 400, "invalid-argument");
  expect_problem(patch(one, R"({"pinned":1})"), 400, "invalid-argument");
  expect_problem(patch(std::string(kLoops) + "/77", R"({"pinned":true})"), 404, "not-found");
  expect_problem(send("PATCH", one, "{}", {{"Content-Type", "text/plain"}}), 415, "unsupported");
}

TEST_F(ApiGraph, WrongLoopsAreRefusedAndChangeNothing) {
  const std::string pose = R"(,"pose":[1,0,0,0,0,0,1])";
  for (const std::string& body :
       {std::string("{}"), R"({"from":1,"to":1)" + pose + "}", R"({"from":1)" + pose + "}",
        std::string(R"({"from":1,"to":2,"pose":[null,0,0,0,0,0,1]})"),
        std::string(R"({"from":1,"to":2,"pose":[0,0,0,0,0,0,3]})"),
        R"({"detect":1,"from":1,"to":2)" + pose + "}", std::string(R"({"detect":-1})"),
        R"({"from":1,"to":2,"information":[)" + std::string("0,0,0,0,0,0,") +
            "0,0,0,0,0,0,0,0,0,0,0,0,0,0,0]" + pose + "}"}) {
    expect_problem(post(kLoops, body), 400, "invalid-argument");
  }
  expect_problem(add_loop(1, 99, 3), 404, "not-found");
  expect_problem(post(kLoops, R"({"detect":99})"), 404, "not-found");
  expect_problem(post("/v1/maps/none/loops", R"({"detect":1})"), 404, "not-found");
  expect_problem(send("POST", kLoops, "{}", {{"Content-Type", "text/plain"}}), 415, "unsupported");
  expect_problem(get(std::string(kLoops) + "/x"), 400, "invalid-argument");
  expect_problem(send("DELETE", std::string(kLoops) + "/x"), 400, "invalid-argument");
  expect_problem(get("/v1/maps/none/loops"), 404, "not-found");
  EXPECT_EQ(json_of(get("/v1/maps/town"))["revision"], 3);
}

TEST_F(ApiGraph, DetectionThatFindsNothingIsNoError) {
  // All CELLs are the latest of one session: none of them is a candidate.
  const auto nothing = post(kLoops, R"({"detect":3})");
  EXPECT_EQ(nothing.status, 200) << body_view(nothing);
  EXPECT_TRUE(json_of(nothing)["loops"].empty());
  EXPECT_EQ(json_of(nothing)["revision"], 3);
}

TEST_F(ApiGraph, TheTrajectoryOfAnUnknownSessionIsNotFound) {
  expect_problem(get("/v1/maps/town/trajectory"), 400, "invalid-argument");
  expect_problem(get("/v1/maps/town/trajectory?session=x"), 404, "not-found");
  expect_problem(get("/v1/maps/town/trajectory?session=x&format=csv"), 400, "invalid-argument");
  expect_problem(get("/v1/maps/town/trajectory?session=x&stage=none"), 400, "invalid-argument");
}

}  // namespace
}  // namespace cellmap::server::test
