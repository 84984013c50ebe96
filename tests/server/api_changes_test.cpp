#include <future>

#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/pose_grid.hpp"
#include "cellmap/codec/zstd.hpp"
#include "server/server_fixture.hpp"
#include "support/drifting_loop.hpp"

namespace cellmap::server::test {
namespace {

const Headed kAcceptBinary{"Accept", "application/vnd.cellmap.changes"};
const Headed kAcceptZstd{"Accept-Encoding", "zstd"};
constexpr const char* kChanges = "/v1/maps/town/changes";
constexpr const char* kEvents = "/v1/maps/town/events";

class ApiChanges : public ApiTest {
 protected:
  ApiChanges() {
    make_map();
    put_street(3);  // revision 3
  }

  Response add_loop(int from, int to, double x) {
    return post("/v1/maps/town/loops", R"({"from":)" + std::to_string(from) + R"(,"to":)" +
                                           std::to_string(to) + R"(,"pose":[)" + std::to_string(x) +
                                           ",0,0,0,0,0,1]}");
  }
  /// Pieces of a stream until one has `text`, or the stream ends.
  std::string read_until(const Response& response, const std::string& text) {
    std::string all;
    const auto& next = std::get<BodyStream>(response.body);
    while (all.find(text) == std::string::npos) {
      if (!next(all)) return all + "(end)";
    }
    return all;
  }
};

MapChanges binary(const Response& response) {
  EXPECT_EQ(response.headers.get("Content-Type"), "application/vnd.cellmap.changes");
  return decode_changes(as_bytes(body_view(response)));
}

TEST_F(ApiChanges, BothFormsSayTheSame) {
  ASSERT_EQ(add_loop(1, 2, 7).status, 201);  // revision 4
  const std::string target = std::string(kChanges) + "?since=2";
  const Json json = json_of(get(target));
  const MapChanges changes = binary(get(target, {kAcceptBinary}));
  EXPECT_EQ(changes.since, 2u);
  EXPECT_EQ(changes.revision, 4u);
  ASSERT_EQ(changes.added.size(), 1u);
  EXPECT_EQ(to_hex(changes.added[0].hash), json["added"][0]["hash"]);
  EXPECT_EQ(changes.added[0].encoded_bytes, json["added"][0]["bytes"]);
  ASSERT_EQ(changes.moved.size(), 1u);
  EXPECT_NEAR(changes.moved.at({2}).translation().x(), json["moved"][0]["pose"][0],
              kGridTranslationError_m);
  ASSERT_EQ(changes.added_constraints.size(), 1u);
  EXPECT_EQ(changes.added_constraints[0].T_from_to.translation().x(), 7.0);
  EXPECT_EQ(get(target).headers.get("CELLmap-Created"),
            json_of(get("/v1/maps/town"))["created"].get<std::string>());
}

TEST_F(ApiChanges, JsonIsWhatAClientGetsThatAsksForNothing) {
  for (const std::vector<Headed>& headers :
       {std::vector<Headed>{}, {{"Accept", "*/*"}}, {{"Accept", "application/json"}}}) {
    EXPECT_EQ(get(kChanges, headers).headers.get("Content-Type"), "application/json");
    EXPECT_FALSE(get(kChanges, headers).headers.get("Content-Encoding"));
  }
  expect_problem(get(kChanges, {{"Accept", "image/png"}}), 406, "not-acceptable");
}

TEST_F(ApiChanges, AreCompressedWhereTheClientTakesItAndItHelps) {
  for (const Headed& accept : {kAcceptBinary, Headed{"Accept", "application/json"}}) {
    const Response plain = get(kChanges, {accept}), packed = get(kChanges, {accept, kAcceptZstd});
    EXPECT_EQ(packed.headers.get("Content-Encoding"), "zstd");
    EXPECT_EQ(packed.headers.get("Vary"), "Accept, Accept-Encoding");
    const Bytes unpacked = zstd_decompress(as_bytes(body_view(packed)), kMaxChangesBytes);
    EXPECT_EQ(to_text(unpacked), body_view(plain));
  }
  const Response empty = get(std::string(kChanges) + "?since=3", {kAcceptBinary, kAcceptZstd});
  EXPECT_LT(body_view(empty).size(), 100u);
}

TEST_F(ApiChanges, AWaitThatCannotBeIsRefused) {
  for (const char* wait : {"-1", "61", "x", "nan"}) {
    expect_problem(get(std::string(kChanges) + "?since=3&wait_s=" + wait), 400, "invalid-argument");
  }
  expect_problem(get("/v1/maps/none/changes?since=0&wait_s=5"), 404, "not-found");
  expect_problem(get(std::string(kChanges) + "?since=4&wait_s=5"), 404, "not-found");
}

TEST_F(ApiChanges, AWaitForWhatIsThereAlreadyEndsAtOnce) {
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_EQ(json_of(get(std::string(kChanges) + "?since=2&wait_s=60"))["revision"], 3);
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(30));
}

TEST_F(ApiChanges, AWaitInVainEndsWithAnEmptyAnswer) {
  const Json json = json_of(get(std::string(kChanges) + "?since=3&wait_s=0.05"));
  EXPECT_EQ(json["revision"], 3);
  EXPECT_TRUE(json["added"].empty());
}

TEST_F(ApiChanges, AWaitEndsWithTheCommitThatItWaitsFor) {
  auto waiting = std::async(std::launch::async, [&] {
    return api_->handle({"GET", std::string(kChanges) + "?since=3&wait_s=60", {}, {}, "wait"});
  });
  ASSERT_EQ(add_loop(1, 2, 7).status, 201);
  EXPECT_EQ(json_of(waiting.get())["moved"][0]["id"], 2);
}

TEST_F(ApiChanges, AWaitEndsWhenTheMapIsDeletedOrTheServerStops) {
  const auto wait = [&] {
    return std::async(std::launch::async, [&] {
      return api_->handle({"GET", std::string(kChanges) + "?since=3&wait_s=60", {}, {}, "wait"});
    });
  };
  auto stopped = wait();
  api_->stop();
  EXPECT_EQ(stopped.get().status, 200);
  start();
  auto deleted = wait();
  while (api_->handle({"GET", "/metrics", {}, {}, "poll"}).status == 200 &&
         body_view(api_->handle({"GET", "/metrics", {}, {}, "poll"}))
                 .find("cellmap_event_followers 1") == std::string::npos) {
    std::this_thread::yield();
  }
  ASSERT_EQ(send("DELETE", "/v1/maps/town").status, 204);
  expect_problem(deleted.get(), 404, "not-found");
}

TEST_F(ApiChanges, EventsTellThePresentRevisionAndEveryLaterOne) {
  const Response stream = get(kEvents);
  ASSERT_EQ(stream.status, 200);
  EXPECT_EQ(stream.headers.get("Content-Type"), "text/event-stream");
  const std::string first = read_until(stream, "\n\n");
  EXPECT_EQ(first.rfind("event: revision\nid: 3\ndata: {\"map\":\"town\",\"revision\":3,", 0), 0u)
      << first;
  ASSERT_EQ(add_loop(1, 2, 7).status, 201);
  EXPECT_NE(read_until(stream, "event: revision").find("id: 4\n"), std::string::npos);
}

TEST_F(ApiChanges, AFollowerThatComesBackHearsOnlyWhatIsNew) {
  const Response same = get(kEvents, {{"Last-Event-ID", "3"}});
  EXPECT_EQ(read_until(same, "\n\n"), ": still here\n\n");
  const Response behind = get(kEvents, {{"Last-Event-ID", "1"}});
  EXPECT_NE(read_until(behind, "\n\n").find("id: 3\n"), std::string::npos);
  const Response of_another_map = get(kEvents, {{"Last-Event-ID", "77"}});
  EXPECT_NE(read_until(of_another_map, "\n\n").find("id: 3\n"), std::string::npos);
  expect_problem(get(kEvents, {{"Last-Event-ID", "yesterday"}}), 400, "invalid-argument");
  expect_problem(get("/v1/maps/none/events"), 404, "not-found");
}

TEST_F(ApiChanges, EventsEndWithTheMapAndWithTheServer) {
  const Response of_map = get(kEvents, {{"Last-Event-ID", "3"}});
  ASSERT_EQ(send("DELETE", "/v1/maps/town").status, 204);
  const std::string gone = read_until(of_map, "event: end");
  EXPECT_NE(gone.find(R"("reason":"deleted")"), std::string::npos) << gone;
  make_map();
  const Response again = get(kEvents, {{"Last-Event-ID", "0"}});
  ASSERT_EQ(send("DELETE", "/v1/maps/town").status, 204);
  make_map();  // by the same name: another map
  EXPECT_NE(read_until(again, "event: end").find(R"("reason":"deleted")"), std::string::npos);
  const Response of_server = get(kEvents, {{"Last-Event-ID", "0"}});
  api_->stop();
  const std::string last = read_until(of_server, "event: end");
  EXPECT_NE(last.find(R"("reason":"stopping")"), std::string::npos) << last;
}

TEST_F(ApiChanges, FollowersAreLimitedAndMakeRoomWhenTheyGo) {
  auto two = options();
  two.max_followers = 2;
  start(two);
  {
    const Response first = get(kEvents), second = get(kEvents);
    expect_problem(get(kEvents), 503, "unavailable");
    expect_problem(get(std::string(kChanges) + "?since=3&wait_s=1"), 503, "unavailable");
    EXPECT_EQ(get(std::string(kChanges) + "?since=2&wait_s=1").status, 200);  // has not to wait
  }
  EXPECT_EQ(get(kEvents).status, 200);
}

// --- The size of an update after a loop, over the API ----------------------------------------

class ApiThinLink : public ApiTest {};

TEST_F(ApiThinLink, AfterALoopOnAMapAsLargeAsKitti00LessThan15KilobytesTravel) {
  constexpr std::size_t kCells = 577;
  make_map();
  const auto loop = cellmap::test::drifting_loop(kCells, 6.0);
  MapUpdate cells;
  for (std::uint32_t i = 0; i < kCells; ++i) {
    Cell cell;
    cell.lattice = kLattice;
    cell.session = "drive";
    cell.sequence = i;
    cell.T_odom_cell = loop.drifted[i];
    NewCell added;
    added.id = CellId{i + 1};
    added.encoded = encode_cell(cell);
    added.cell = std::make_shared<const Cell>(cell);
    added.T_map_cell = loop.drifted[i];
    cells.cells.push_back(std::move(added));
  }
  const Revision since = store_->commit("town", cells).revision;
  MapUpdate closed;
  for (std::uint32_t i = 1; i < kCells; ++i) closed.poses[CellId{i + 1}] = loop.corrected[i];
  Constraint constraint;
  constraint.from = CellId{kCells};
  constraint.to = CellId{1};
  constraint.kind = ConstraintKind::kLoop;
  constraint.T_from_to = loop.corrected.back().inverse() * loop.corrected.front();
  const Matrix6d root = Matrix6d::Random();
  constraint.information = 1e4 * root * root.transpose();
  constraint.scores = {10'000, 9'000, 0.71234, 0.81234, 0.00123, 0.04321, 0.01234};
  closed.add_constraints = {constraint};
  store_->commit("town", closed);

  const std::string target = std::string(kChanges) + "?since=" + std::to_string(since);
  const auto size = [&](const std::vector<Headed>& headers) {
    return body_view(get(target, headers)).size();
  };
  const std::size_t on_the_wire = size({kAcceptBinary, kAcceptZstd});
  std::cout << "one loop, " << kCells << " CELLs moved, bytes: JSON " << size({})
            << ", JSON + zstd " << size({kAcceptZstd}) << ", binary " << size({kAcceptBinary})
            << ", binary + zstd " << on_the_wire << '\n';
  EXPECT_LT(on_the_wire, 15'000u);
  EXPECT_LT(size({kAcceptBinary}), 15'000u);  // even where nothing compresses

  const MapChanges changes = binary(get(target, {kAcceptBinary}));
  ASSERT_EQ(changes.moved.size(), kCells - 1);
  for (const auto& [id, pose] : store_->pose_graph("town").nodes) {
    if (id.value == 1) continue;
    const Pose& sent = changes.moved.at(id);
    EXPECT_LE((sent.translation() - pose.translation()).norm(), kGridTranslationError_m);
    EXPECT_LE(angle_between_rad(sent, pose), kGridRotationError_rad);
  }
  ASSERT_EQ(changes.added_constraints.size(), 1u);
  EXPECT_EQ(changes.added_constraints[0].scores.points, 10'000u);
}

}  // namespace
}  // namespace cellmap::server::test
