#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kJobs = "/v1/maps/town/jobs";
constexpr std::size_t kScans = 24;  // a metre apart: CELLs begin at scans 0, 7, 14 and 21

class ApiJobs : public ApiTest {
 protected:
  ApiJobs() { write_drive(folder_.path() / "data" / "drive", kScans); }

  static std::string job(const std::string& members, const std::string& options = "") {
    return R"({"kind":"ingest","create_map":true,"lattice":{"kind":"fibonacci","size":6000},)" +
           members + R"(,"options":{"loop_closures":false)" + options + "}}";
  }
  static std::string upload(std::size_t scans_total) {
    return job(R"("session":"drive","upload":true,"scans_total":)" + std::to_string(scans_total));
  }

  Json ingest(const std::string& map, const std::string& members = R"("path":"drive")") {
    const auto made = post("/v1/maps/" + map + "/jobs", job(members));
    EXPECT_EQ(made.status, 202) << body_view(made);
    return ended_job(json_of(made));
  }

  Response put_scan(const Json& id, std::size_t index, std::size_t content) {
    return send("PUT", "/v1/jobs/" + id.dump() + "/scans/" + std::to_string(index),
                to_text(encode_scan(street_scan(content))),
                {{"Content-Type", "application/vnd.cellmap.scan"}});
  }
  /// As a client should: again where the queue is full, and where the server says.
  void put_scans(const Json& id, std::size_t end) {
    for (std::size_t index = json_of(get("/v1/jobs/" + id.dump()))["next_scan"]; index < end;) {
      const auto answer = put_scan(id, index, index);
      if (answer.status == 204) {
        ++index;
      } else if (answer.status == 503) {
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
      } else {
        ASSERT_EQ(answer.status, 409) << body_view(answer);
        index = json_of(answer)["next_scan"];
      }
    }
  }

  void wait_for_cells(const Json& id, int cells) {
    for (int i = 0; i < 1500; ++i) {
      if (json_of(get("/v1/jobs/" + id.dump()))["cells_done"] >= cells) return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    FAIL() << "the job made no " << cells << " CELLs";
  }

  /// What must not depend on how a drive came in: hashes and poses of all CELLs, and the
  /// constraints.
  Json content(const std::string& map) {
    Json json = json_of(get("/v1/maps/" + map + "/pose-graph", {{"Accept", "application/json"}}));
    json.erase("revision");
    const Json page = json_of(get("/v1/maps/" + map + "/cells"));
    for (const auto& cell : page["cells"]) {
      json["hashes"].push_back(cell["hash"]);
    }
    json["trajectory"] =
        std::string(body_view(get("/v1/maps/" + map + "/trajectory?session=drive&format=kitti")));
    return json;
  }
};

TEST_F(ApiJobs, ADriveBelowTheDataRootBecomesAMap) {
  const Json ended = ingest("town");
  EXPECT_EQ(ended["state"], "succeeded") << ended.dump();
  EXPECT_EQ(ended["scans_done"], kScans);
  EXPECT_EQ(ended["progress"], 1.0);
  const Json map = json_of(get("/v1/maps/town"));
  EXPECT_EQ(map["cells"], 4);
  EXPECT_EQ(map["scans"], kScans);
  EXPECT_EQ(map["sessions"], Json({"drive"}));
  std::size_t points = 0;
  for (std::size_t i = 0; i < kScans; ++i) points += street_scan(i).points.size();
  EXPECT_EQ(map["raw_points"], points);
  EXPECT_GT(map["voxel_points"], 0);
  EXPECT_LT(map["voxel_points"], points);
  EXPECT_EQ(json_of(get(kJobs))["jobs"].size(), 1u);
}

TEST_F(ApiJobs, AServerThatCarriesOutNoneLeavesThoseOfTheOtherAloneAndRefusesNewOnes) {
  JobRecord of_the_other;
  of_the_other.map = "town";
  of_the_other.kind = "ingest";
  of_the_other.state = JobState::kRunning;
  store_->create_map("town", {});
  const JobRecord left = store_->create_job(of_the_other);
  ApiOptions api_only = options();
  api_only.jobs.carries_out = false;
  start(std::move(api_only));
  EXPECT_EQ(store_->job(left.id).state, JobState::kRunning);
  const Response refused = post(kJobs, upload(4));
  EXPECT_EQ(refused.status, 503);
  EXPECT_NE(std::string(body_view(refused)).find("--role"), std::string::npos);
}

TEST_F(ApiJobs, TheTrajectoryCoversEveryScanBeforeAndAfterTheBackEnd) {
  ingest("town");
  const std::string target = "/v1/maps/town/trajectory?session=drive&format=kitti";
  const std::string odometry(body_view(get(target + "&stage=odometry")));
  EXPECT_EQ(std::ranges::count(odometry, '\n'), static_cast<long>(kScans));
  const std::string corrected(body_view(get(target)));
  EXPECT_EQ(std::ranges::count(corrected, '\n'), static_cast<long>(kScans));
  EXPECT_EQ(get("/v1/maps/town/trajectory?session=drive").status, 200);
}

TEST_F(ApiJobs, PostingAFinishedSessionAgainChangesNothing) {
  ingest("town");
  const Json before = json_of(get("/v1/maps/town"));
  const Json again = ingest("town");
  EXPECT_EQ(again["state"], "succeeded");
  EXPECT_EQ(again["scans_done"], kScans);
  EXPECT_EQ(json_of(get("/v1/maps/town")), before);
}

TEST_F(ApiJobs, UploadedScansGiveTheSameMapAsThePath) {
  ingest("town");
  const Json id = json_of(post("/v1/maps/uploaded/jobs", upload(kScans)))["id"];
  put_scans(id, kScans);
  const auto completed = send("POST", "/v1/jobs/" + id.dump() + "/complete");
  EXPECT_EQ(completed.status, 202) << body_view(completed);
  EXPECT_EQ(ended_job({{"id", id}})["state"], "succeeded");
  EXPECT_EQ(content("uploaded"), content("town"));
  EXPECT_EQ(send("POST", "/v1/jobs/" + id.dump() + "/complete").status, 202);
}

TEST_F(ApiJobs, AnUploadGoesOnAfterARestartAndTheMapIsTheSame) {
  ingest("town");
  const Json id = json_of(post("/v1/maps/uploaded/jobs", upload(kScans)))["id"];
  put_scans(id, 18);
  wait_for_cells(id, 2);
  start();
  const Json resumed = json_of(get("/v1/jobs/" + id.dump()));
  EXPECT_THAT(resumed["state"], ::testing::AnyOf("queued", "running"));
  EXPECT_EQ(resumed["next_scan"], 7);  // the base scan of the last stored CELL
  // Who had sent all scans before is told which are lost, instead of ending a drive that lacks
  // some.
  for (const std::string& path : {"/v1/jobs/" + id.dump() + "/complete",
                                  std::string("/v1/maps/uploaded/sessions/drive/scans:complete")}) {
    const auto early = send("POST", path + "?scans=" + std::to_string(kScans));
    expect_problem(early, 409, "conflict");
    EXPECT_EQ(json_of(early)["next_scan"], 7);
  }
  put_scans(id, kScans);
  send("POST", "/v1/jobs/" + id.dump() + "/complete");
  EXPECT_EQ(ended_job({{"id", id}})["state"], "succeeded");
  EXPECT_EQ(content("uploaded"), content("town"));
}

TEST_F(ApiJobs, APathGoesOnAfterItsLastStoredCell) {
  ingest("town");
  // A first part of the drive, cancelled: whole CELLs stay.
  const Json id = json_of(post("/v1/maps/part/jobs", upload(kScans)))["id"];
  put_scans(id, 16);
  wait_for_cells(id, 2);
  EXPECT_EQ(send("DELETE", "/v1/jobs/" + id.dump()).status, 202);
  EXPECT_EQ(ended_job({{"id", id}})["state"], "cancelled");
  expect_problem(send("POST", "/v1/jobs/" + id.dump() + "/complete"), 409, "conflict");
  EXPECT_EQ(json_of(get("/v1/maps/part"))["cells"], 2);
  EXPECT_EQ(ingest("part")["state"], "succeeded");
  EXPECT_EQ(content("part"), content("town"));
}

TEST_F(ApiJobs, ScansComeInOrderAndAreTakenOnce) {
  const Json id = json_of(post(kJobs, upload(0)))["id"];
  EXPECT_EQ(put_scan(id, 0, 0).status, 204);
  const auto skipped = put_scan(id, 5, 5);
  expect_problem(skipped, 409, "conflict");
  EXPECT_EQ(json_of(skipped)["next_scan"], 1);
  EXPECT_EQ(put_scan(id, 0, 3).status, 204);  // had it already: ignored
  EXPECT_EQ(json_of(get("/v1/jobs/" + id.dump()))["next_scan"], 1);
  send("POST", "/v1/jobs/" + id.dump() + "/complete");
  expect_problem(put_scan(id, 1, 1), 409, "conflict");
  EXPECT_EQ(ended_job({{"id", id}})["scans_done"], 1);
}

TEST_F(ApiJobs, AFullQueueAsksTheClientToWait) {
  ApiOptions narrow = options();
  narrow.jobs.upload.max_scans = 2;
  narrow.jobs.upload.room_timeout = std::chrono::milliseconds(10);
  narrow.jobs.workers = 1;
  start(narrow);
  const Json blocking = json_of(post(kJobs, upload(0)))["id"];  // keeps the only worker
  for (int i = 0; i < 500 && json_of(get("/v1/jobs/" + blocking.dump()))["state"] != "running";
       ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  const Json id = json_of(post("/v1/maps/other/jobs", upload(0)))["id"];
  EXPECT_EQ(put_scan(id, 0, 0).status, 204);
  EXPECT_EQ(put_scan(id, 1, 1).status, 204);
  const auto full = put_scan(id, 2, 2);
  expect_problem(full, 503, "unavailable");
  EXPECT_TRUE(full.headers.get("Retry-After"));
}

TEST_F(ApiJobs, AnUploadThatFallsSilentFailsAndSaysSo) {
  ApiOptions impatient = options();
  impatient.jobs.upload.idle_timeout = std::chrono::milliseconds(30);
  start(impatient);
  const Json ended = ended_job(json_of(post(kJobs, upload(0))));
  EXPECT_EQ(ended["state"], "failed");
  EXPECT_EQ(ended["error"]["code"], "unavailable");
}

TEST_F(ApiJobs, PostingARunningSessionGivesTheSameJob) {
  const Json first = json_of(post(kJobs, upload(0)));
  EXPECT_EQ(json_of(post(kJobs, upload(0)))["id"], first["id"]);
  expect_problem(post(kJobs, job(R"("path":"drive")")), 409, "conflict");
}

TEST_F(ApiJobs, AJobGoesOnFromWhatOthersChangeInItsMap) {
  const Json id = json_of(post(kJobs, upload(0)))["id"];
  put_scans(id, 16);
  wait_for_cells(id, 2);
  const auto loop = post("/v1/maps/town/loops", R"({"from":1,"to":2,"pose":[7,0,0,0,0,0,1]})");
  EXPECT_EQ(loop.status, 201) << body_view(loop);
  EXPECT_EQ(put_cell(99, street_cell(0, 0, "other")).status, 201);
  expect_problem(send("DELETE", "/v1/maps/town"), 409, "conflict");
  put_scans(id, 24);
  wait_for_cells(id, 3);
  EXPECT_EQ(json_of(get("/v1/maps/town/cells"))["cells"].back()["id"], 100);
  EXPECT_EQ(json_of(get("/v1/maps/town/loops"))["loops"].size(), 1u);
  send("DELETE", "/v1/jobs/" + id.dump());
  ended_job({{"id", id}});
  EXPECT_EQ(send("DELETE", "/v1/maps/town").status, 204);
}

TEST_F(ApiJobs, AFailedJobSaysWhy) {
  std::ofstream(folder_.path() / "data" / "drive" / "velodyne" / "000009.bin") << "torn";
  const Json ended = ingest("town");
  EXPECT_EQ(ended["state"], "failed");
  EXPECT_EQ(ended["error"]["code"], "corrupt-data");
  EXPECT_THAT(ended["error"]["message"].get<std::string>(), ::testing::HasSubstr("000009"));
  EXPECT_EQ(json_of(get("/v1/maps/town"))["cells"], 1);  // the whole CELL before it stays
}

TEST_F(ApiJobs, PathsOutsideOfTheDataRootsAreRefused) {
  const auto outside = folder_.path() / "secret";
  write_drive(outside, 2);
  const auto data = folder_.path() / "data";
  std::filesystem::create_directory_symlink(outside, data / "escape");
  std::filesystem::create_directories(data / "mixed");
  std::filesystem::create_directory_symlink(outside / "velodyne", data / "mixed" / "velodyne");
  for (const std::string& path :
       {std::string("/etc"), outside.string(), std::string("../secret"),
        std::string("drive/../../secret"), std::string("escape"), std::string("")}) {
    const auto answer = post(kJobs, job(R"("session":"x","path":")" + path + '"'));
    expect_problem(answer, 400, "invalid-argument");
  }
  const Json mixed = ingest("town", R"("path":"mixed")");
  EXPECT_EQ(mixed["state"], "failed");
  EXPECT_EQ(mixed["error"]["code"], "invalid-argument");
  expect_problem(post(kJobs, job(R"("path":"missing")")), 404, "not-found");
}

TEST_F(ApiJobs, AServerWithoutDataRootsReadsNoPaths) {
  ApiOptions closed = options();
  closed.jobs.data_roots.clear();
  start(closed);
  expect_problem(post(kJobs, job(R"("path":"drive")")), 400, "invalid-argument");
}

TEST_F(ApiJobs, WrongJobsAreRefused) {
  for (const std::string& body :
       {std::string("{}"), std::string(R"({"kind":"dance"})"), std::string(R"({"kind":"ingest"})"),
        job(R"("path":"drive","upload":true)"), job(R"("upload":true)"),
        job(R"("session":"a/b","upload":true)"), job(R"("path":"drive","pose_frame":"wheel")"),
        job(R"("path":"drive")", R"(,"fit":"magic")"),
        job(R"("path":"drive")", R"(,"loop_acceptance":"all")"),
        job(R"("path":"drive")", R"(,"cell_distance_m":-1)"),
        job(R"("path":"drive")", R"(,"colour":"red")")}) {
    expect_problem(post(kJobs, body), 400, "invalid-argument");
  }
  expect_problem(post(kJobs, R"({"kind":"ingest","path":"drive"})"), 404, "not-found");
  expect_problem(post("/v1/maps/UPPER/jobs", job(R"("path":"drive")")), 400, "invalid-argument");
  expect_problem(send("POST", kJobs, "{}", {{"Content-Type", "text/plain"}}), 415, "unsupported");
  expect_problem(get(kJobs), 404, "not-found");
}

TEST_F(ApiJobs, WrongScansAreRefused) {
  const Json id = json_of(post(kJobs, upload(0)))["id"];
  const std::string target = "/v1/jobs/" + id.dump() + "/scans/0";
  const Headed type{"Content-Type", "application/vnd.cellmap.scan"};
  expect_problem(send("PUT", target, "junk", {type}), 422, "corrupt-data");
  expect_problem(send("PUT", target, "junk", {{"Content-Type", "text/plain"}}), 415, "unsupported");
  expect_problem(send("PUT", target, std::string(34u << 20, 'x'), {type}), 413, "too-large");
  expect_problem(send("PUT", "/v1/jobs/" + id.dump() + "/scans/-1", "junk", {type}), 400,
                 "invalid-argument");
  expect_problem(put_scan(99, 0, 0), 404, "not-found");
  EXPECT_EQ(json_of(get("/v1/jobs/" + id.dump()))["next_scan"], 0);
}

TEST_F(ApiJobs, JobsThatAreNotThereOrHaveEndedSaySo) {
  expect_problem(get("/v1/jobs/99"), 404, "not-found");
  expect_problem(get("/v1/jobs/x"), 400, "invalid-argument");
  expect_problem(get("/v1/jobs/99/events"), 404, "not-found");
  expect_problem(get("/v1/jobs/x/events"), 400, "invalid-argument");
  expect_problem(send("DELETE", "/v1/jobs/x"), 400, "invalid-argument");
  expect_problem(send("POST", "/v1/jobs/x/complete"), 400, "invalid-argument");
  expect_problem(send("DELETE", "/v1/jobs/99"), 404, "not-found");
  expect_problem(send("POST", "/v1/jobs/99/complete"), 404, "not-found");
  const Json ended = ingest("town");
  const std::string target = "/v1/jobs/" + ended["id"].dump();
  expect_problem(send("DELETE", target), 409, "conflict");
  expect_problem(put_scan(ended["id"], 0, 0), 409, "conflict");
}

TEST_F(ApiJobs, EventsTellProgressBeatAndEnd) {
  const Json id = json_of(post(kJobs, upload(0)))["id"];
  const auto response = get("/v1/jobs/" + id.dump() + "/events");
  EXPECT_EQ(response.headers.get("Content-Type"), "text/event-stream");
  const auto next = std::get<BodyStream>(response.body);
  std::string text;
  EXPECT_TRUE(next(text));
  EXPECT_THAT(text, ::testing::StartsWith("event: progress\ndata: {\"id\":" + id.dump()));
  for (int i = 0; i < 40 && text.find("\n: ") == std::string::npos; ++i) EXPECT_TRUE(next(text));
  EXPECT_THAT(text, ::testing::HasSubstr("\n: "));  // a heartbeat
  send("POST", "/v1/jobs/" + id.dump() + "/complete");
  ended_job({{"id", id}});
  text.clear();
  while (next(text)) {
  }
  EXPECT_THAT(text, ::testing::HasSubstr("event: end\ndata: "));
  EXPECT_THAT(text, ::testing::HasSubstr("\"state\":\"succeeded\""));
}

TEST_F(ApiJobs, FollowersAreLimitedAndStreamsEndWithTheServer) {
  ApiOptions two = options();
  two.max_followers = 2;
  start(two);
  const Json id = json_of(post(kJobs, upload(0)))["id"];
  const std::string events = "/v1/jobs/" + id.dump() + "/events";
  auto first = get(events);
  const auto second = get(events);
  expect_problem(get(events), 503, "unavailable");
  first = {};
  EXPECT_EQ(get(events).status, 200);
  std::string text;
  api_->stop();
  EXPECT_FALSE(std::get<BodyStream>(second.body)(text));
}

}  // namespace
}  // namespace cellmap::server::test
