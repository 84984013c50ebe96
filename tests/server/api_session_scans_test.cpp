#include "cellmap/codec/scan_batch.hpp"
#include "cellmap/codec/zstd.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kScansOfDrive = "/v1/maps/town/sessions/drive/scans";
constexpr std::size_t kDrive = 24;  // a metre apart: CELLs begin at scans 0, 7, 14 and 21
const Headed kOne{"Content-Type", "application/vnd.cellmap.scan"};
const Headed kSeveral{"Content-Type", "application/vnd.cellmap.scans"};

class ApiSessionScans : public ApiTest {
 protected:
  ApiSessionScans() { make_map(); }

  static std::string batch(std::size_t begin, std::size_t end) {
    Bytes bytes;
    for (std::size_t i = begin; i < end; ++i) append_to_scan_batch(bytes, street_scan(i));
    return to_text(bytes);
  }
  Response post_scans(std::size_t begin, std::size_t end,
                      const std::string& target = kScansOfDrive) {
    return send("POST", target, batch(begin, end), {kSeveral});
  }
  /// As a client should, `step` scans a request: on from where the answer says.
  void send_scans(std::size_t begin, std::size_t end, std::size_t step,
                  const std::string& target = kScansOfDrive) {
    for (std::size_t next = begin; next < end;) {
      const auto answer = post_scans(next, std::min(next + step, end), target);
      ASSERT_THAT(answer.status, ::testing::AnyOf(202, 409, 503)) << body_view(answer);
      next = json_of(answer)["next_scan"];
    }
  }
  Response complete(const std::string& target = kScansOfDrive) {
    return send("POST", target + ":complete");
  }
  Json standing(const std::string& target = kScansOfDrive) { return json_of(get(target)); }
  Json ended() { return ended_job(standing()["job"]); }

  /// Again, on the same store, with a server that soon takes a silent robot for one that rests.
  void start_impatient() {
    ApiOptions impatient = options();
    impatient.jobs.upload.idle_timeout = std::chrono::milliseconds(30);
    start(impatient);
  }

  void wait_for_cells(int cells) {
    for (int i = 0; i < 1500 && standing()["job"]["cells_done"] < cells; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ASSERT_GE(standing()["job"]["cells_done"], cells);
  }
  void wait_for_job_state(const std::string& state) {
    for (int i = 0; i < 1500 && standing()["job"]["state"] != state; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ASSERT_EQ(standing()["job"]["state"], state);
  }

  /// What must not depend on how a drive came in.
  Json content(const std::string& map) {
    Json json = json_of(get("/v1/maps/" + map + "/pose-graph", {{"Accept", "application/json"}}));
    json.erase("revision");
    const Json page = json_of(get("/v1/maps/" + map + "/cells"));
    for (const auto& cell : page["cells"]) {
      json["hashes"].push_back(cell["hash"]);
    }
    return json;
  }

  /// The drive read from a path, as map "by-path".
  Json undisturbed() {
    write_drive(folder_.path() / "data" / "drive", kDrive);
    const auto made = post(
        "/v1/maps/by-path/jobs",
        R"({"kind":"ingest","path":"drive","create_map":true,"lattice":{"kind":"fibonacci","size":6000}})");
    EXPECT_EQ(ended_job(json_of(made))["state"], "succeeded");
    return content("by-path");
  }
};

TEST_F(ApiSessionScans, ARobotThatSendsAsItDrivesMakesTheMapThatThePathMakes) {
  EXPECT_EQ(standing()["state"], "new");
  EXPECT_EQ(standing()["next_scan"], 0);
  const auto first = send("POST", kScansOfDrive, to_text(encode_scan(street_scan(0))), {kOne});
  ASSERT_EQ(first.status, 202) << body_view(first);
  EXPECT_EQ(json_of(first)["taken"], 1);
  EXPECT_EQ(json_of(first)["state"], "mapping");
  send_scans(1, kDrive, 5);
  EXPECT_EQ(standing()["next_scan"], kDrive);
  const auto completed = complete();
  EXPECT_EQ(completed.status, 202) << body_view(completed);
  EXPECT_EQ(ended()["state"], "succeeded");
  EXPECT_EQ(standing()["state"], "ended");
  EXPECT_EQ(standing()["next_scan"], kDrive);
  EXPECT_EQ(complete().status, 202);
  EXPECT_EQ(content("town"), undisturbed());
}

TEST_F(ApiSessionScans, ABodyMayBeCompressed) {
  const Bytes body = zstd_compress(as_bytes(batch(0, 3)), 1);
  const auto answer =
      send("POST", kScansOfDrive, to_text(body), {kSeveral, {"Content-Encoding", "zstd"}});
  EXPECT_EQ(json_of(answer)["taken"], 3) << body_view(answer);
}

TEST_F(ApiSessionScans, ScansComeInOrderAndAreTakenOnce) {
  expect_problem(post_scans(1, 3), 409, "conflict");  // before there is a job
  EXPECT_EQ(standing()["state"], "new");
  EXPECT_EQ(json_of(post_scans(0, 3))["taken"], 3);
  const auto overlapping = post_scans(1, 4);
  EXPECT_EQ(json_of(overlapping)["taken"], 1);
  EXPECT_EQ(json_of(overlapping)["next_scan"], 4);
  EXPECT_EQ(json_of(post_scans(0, 3))["taken"], 0);
  const auto skipped = post_scans(6, 8);
  EXPECT_THAT(expect_problem(skipped, 409, "conflict"), ::testing::HasSubstr("expected scan 4"));
  EXPECT_EQ(json_of(skipped)["next_scan"], 4);
  EXPECT_EQ(standing()["next_scan"], 4);
}

TEST_F(ApiSessionScans, AfterTheEndOnlyScansThatAreThereAreWelcome) {
  send_scans(0, 9, 9);
  complete();
  expect_problem(post_scans(9, 10), 409, "conflict");  // while the job finishes, or after it
  ended();
  const auto late = post_scans(8, 10);
  expect_problem(late, 409, "conflict");
  EXPECT_EQ(json_of(late)["next_scan"], 9);
  EXPECT_EQ(json_of(post_scans(3, 6))["taken"], 0);
  EXPECT_EQ(standing()["keep_from"], 9);
}

TEST_F(ApiSessionScans, OfARequestThatFindsTooLittleRoomTheFirstScansAreTaken) {
  ApiOptions narrow = options();
  narrow.jobs.upload.max_scans = 2;
  narrow.jobs.upload.room_timeout = std::chrono::milliseconds(10);
  narrow.jobs.workers = 1;
  start(narrow);
  const std::string blocking = "/v1/maps/town/sessions/other/scans";
  post_scans(0, 1, blocking);  // keeps the only worker
  for (int i = 0; i < 500 && standing(blocking)["job"]["state"] != "running"; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  const auto part = post_scans(0, 5);
  EXPECT_EQ(part.status, 202) << body_view(part);
  EXPECT_EQ(json_of(part)["taken"], 2);
  EXPECT_EQ(json_of(part)["next_scan"], 2);
  const auto full = post_scans(2, 5);
  expect_problem(full, 503, "unavailable");
  EXPECT_TRUE(full.headers.get("Retry-After"));
  EXPECT_EQ(json_of(full)["next_scan"], 2);
}

TEST_F(ApiSessionScans, GoOnAfterARestartAndTheMapIsTheSame) {
  send_scans(0, 18, 4);
  wait_for_cells(2);
  start();
  const Json resumed = standing();
  EXPECT_EQ(resumed["state"], "mapping");
  EXPECT_EQ(resumed["next_scan"], 7);  // the base scan of the last stored CELL
  EXPECT_EQ(resumed["keep_from"], 7);
  send_scans(18, kDrive, 4);
  complete();
  EXPECT_EQ(ended()["state"], "succeeded");
  EXPECT_EQ(content("town"), undisturbed());
}

TEST_F(ApiSessionScans, ARobotThatRestsFindsItsSessionPausedAndGoesOn) {
  send_scans(0, 10, 10);
  wait_for_cells(1);
  start_impatient();
  wait_for_job_state("failed");
  EXPECT_EQ(standing()["state"], "paused");
  EXPECT_EQ(standing()["next_scan"], 0);  // the base scan of the CELL that is stored
  start();                                // no longer impatient
  EXPECT_EQ(json_of(post_scans(0, 1))["state"], "mapping");
  send_scans(1, kDrive, 6);
  complete();
  EXPECT_EQ(ended()["state"], "succeeded");
  EXPECT_EQ(content("town"), undisturbed());
}

TEST_F(ApiSessionScans, AnEndCanBeSaidOfADriveThatRests) {
  send_scans(0, 10, 10);
  wait_for_cells(1);
  start_impatient();
  wait_for_job_state("failed");
  EXPECT_EQ(complete().status, 202);
  EXPECT_EQ(ended()["state"], "succeeded");
  EXPECT_EQ(standing()["state"], "ended");
  EXPECT_EQ(standing()["next_scan"], 7);  // what the stored CELL holds
}

TEST_F(ApiSessionScans, TheOptionsOfThePostedJobHoldAlsoAfterItWasGoneOnWith) {
  const std::string job =
      R"({"kind":"ingest","session":"drive","upload":true,"options":{"cell_distance_m":3}})";
  const Json id = json_of(post("/v1/maps/town/jobs", job))["id"];
  const Json sent = json_of(post_scans(0, 6));
  EXPECT_EQ(sent["job"]["id"], id);
  start_impatient();
  wait_for_job_state("failed");
  start();
  send_scans(0, 13, 13);
  EXPECT_NE(standing()["job"]["id"], id);
  complete();
  EXPECT_EQ(ended()["cells_done"], 4);  // of four scans each: 0, 4, 8 and 12
}

TEST_F(ApiSessionScans, ACancelledSessionGoesOnOnlyWhereAJobIsPosted) {
  send_scans(0, 9, 9);
  wait_for_cells(1);
  const Json id = standing()["job"]["id"];
  send("DELETE", "/v1/jobs/" + id.dump());
  wait_for_job_state("cancelled");
  EXPECT_EQ(standing()["state"], "stopped");
  EXPECT_THAT(expect_problem(post_scans(0, 1), 409, "conflict"),
              ::testing::HasSubstr("post a job"));
  expect_problem(complete(), 409, "conflict");
  post("/v1/maps/town/jobs", R"({"kind":"ingest","session":"drive","upload":true})");
  EXPECT_EQ(json_of(post_scans(0, 1))["taken"], 1);
}

TEST_F(ApiSessionScans, ASessionThatWasSentAsCellsIsGoneOnWithAfterItsLast) {
  const EncodedCell cell = street_cell(0, 0);  // of scan 0 alone
  ASSERT_EQ(send("PUT", "/v1/maps/town/sessions/drive/cells/" + to_hex(cell.hash),
                 to_text(cell.bytes), {{"Content-Type", "application/vnd.cellmap.cell"}})
                .status,
            201);
  EXPECT_EQ(standing()["state"], "paused");
  EXPECT_TRUE(standing()["job"].is_null());
  send_scans(0, 9, 3);
  complete();
  EXPECT_EQ(ended()["cells_done"], 3);
}

TEST_F(ApiSessionScans, ASessionOfADeletedMapIsNewInTheNextOfThatName) {
  send_scans(0, 3, 3);
  complete();
  ended();
  ASSERT_EQ(send("DELETE", "/v1/maps/town").status, 204);
  make_map();
  EXPECT_EQ(standing()["state"], "new");
  EXPECT_EQ(json_of(post_scans(0, 2))["taken"], 2);
}

TEST_F(ApiSessionScans, WhatIsNotAsItShouldBeTakesNothing) {
  expect_problem(send("POST", kScansOfDrive, "junk", {kOne}), 422, "corrupt-data");
  std::string damaged = batch(0, 3);
  damaged.resize(damaged.size() - 1);
  expect_problem(send("POST", kScansOfDrive, damaged, {kSeveral}), 422, "corrupt-data");
  expect_problem(send("POST", kScansOfDrive, "", {kSeveral}), 422, "corrupt-data");
  expect_problem(send("POST", kScansOfDrive, "{}", {{"Content-Type", "application/json"}}), 415,
                 "unsupported");
  expect_problem(send("POST", kScansOfDrive, std::string(kMaxScanBatchBytes + 1, 'x'), {kSeveral}),
                 413, "too-large");
  const std::string odd = "/v1/maps/town/sessions/a%20b/scans";
  expect_problem(post_scans(0, 1, odd), 400, "invalid-argument");
  expect_problem(get(odd), 400, "invalid-argument");
  expect_problem(complete(odd), 400, "invalid-argument");
  expect_problem(complete(), 404, "not-found");
  EXPECT_EQ(standing()["state"], "new");
}

TEST_F(ApiSessionScans, NeedAMap) {
  const std::string nowhere = "/v1/maps/nowhere/sessions/drive/scans";
  expect_problem(post_scans(0, 1, nowhere), 404, "not-found");
  expect_problem(get(nowhere), 404, "not-found");
  expect_problem(complete(nowhere), 404, "not-found");
}

TEST_F(ApiSessionScans, ASessionThatIsReadFromAPathTakesNoScans) {
  ApiOptions one_worker = options();
  one_worker.jobs.workers = 1;
  start(one_worker);
  post_scans(0, 1, "/v1/maps/town/sessions/other/scans");  // so that the path's job waits
  write_drive(folder_.path() / "data" / "drive", 4);
  ASSERT_EQ(post("/v1/maps/town/jobs", R"({"kind":"ingest","path":"drive"})").status, 202);
  EXPECT_TRUE(standing()["next_scan"].is_null());
  expect_problem(post_scans(0, 1), 409, "conflict");
  expect_problem(complete(), 409, "conflict");
}

}  // namespace
}  // namespace cellmap::server::test
