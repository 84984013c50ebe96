#include "cellmap/store/claims.hpp"
#include "server/server_fixture.hpp"

// Several servers over one store. They are of one process and one SQLite file here, which tells
// them nothing of each other that a database would not: they meet in the store only. Processes over
// PostgreSQL: tests/crash/takeover.py.

namespace cellmap::server::test {
namespace {

constexpr std::size_t kDriveScans = 24;

class ApiFleet : public ApiTest {
 protected:
  ApiFleet() { write_drive(folder_.path() / "data" / "drive", kDriveScans); }

  enum class Role { kAll, kApi, kWorker };
  std::unique_ptr<Api> server(Role role) {
    ApiOptions options = this->options();
    options.jobs.carries_out = role != Role::kApi;
    options.jobs.takes_scans = role != Role::kWorker;
    options.jobs.lease = std::chrono::milliseconds(300);
    return std::make_unique<Api>(*store_, std::move(options));
  }
  /// The fixture's server, which is asked, only takes jobs.
  void only_take_jobs() { api_ = server(Role::kApi); }

  static std::string ingest(const std::string& members) {
    return R"({"kind":"ingest","create_map":true,"lattice":{"kind":"fibonacci","size":6000},)" +
           members + R"(,"options":{"loop_closures":false}})";
  }
  Json submitted(const std::string& map, const std::string& members = R"("path":"drive")") {
    const auto made = post("/v1/maps/" + map + "/jobs", ingest(members));
    EXPECT_EQ(made.status, 202) << body_view(made);
    return json_of(made);
  }
  Json job(const Json& made) { return json_of(get("/v1/jobs/" + made["id"].dump())); }

  Response put_cell_of(Api& api, const std::string& session, const EncodedCell& cell) {
    Request request{"PUT",
                    "/v1/maps/town/sessions/" + session + "/cells/" + to_hex(cell.hash),
                    {},
                    to_text(cell.bytes),
                    "test"};
    request.headers.set("Content-Type", "application/vnd.cellmap.cell");
    return api.handle(request);
  }
};

TEST_F(ApiFleet, AJobThatOneServerTakesAnotherCarriesOutAndAnyTellsOf) {
  only_take_jobs();
  const Json made = submitted("town");
  EXPECT_EQ(made["state"], "queued");
  EXPECT_TRUE(made["worker"].is_null());
  EXPECT_TRUE(made["lease_ends"].is_null());
  const auto worker = server(Role::kWorker);
  const Json ended = ended_job(made);
  EXPECT_EQ(ended["state"], "succeeded") << ended.dump();
  EXPECT_EQ(ended["scans_done"], kDriveScans);
  EXPECT_TRUE(ended["worker"].is_null());
  EXPECT_EQ(json_of(get("/v1/maps/town"))["cells"], 4);
}

TEST_F(ApiFleet, WhoWorksOnAJobIsToldByEveryServer) {
  const auto other = server(Role::kAll);
  only_take_jobs();
  const Json id = [&] {
    Request request{
        "POST", "/v1/maps/town/jobs", {}, ingest(R"("session":"drive","upload":true)"), "test"};
    request.headers.set("Content-Type", "application/json");
    return json_of(other->handle(request));
  }();
  const Json seen = job(id);
  EXPECT_EQ(seen["worker"], id["worker"]);
  EXPECT_FALSE(seen["worker"].get<std::string>().empty());
  EXPECT_TRUE(seen["lease_ends"].is_string());
  const auto refused = expect_problem(
      send("PUT", "/v1/jobs/" + id["id"].dump() + "/scans/0", to_text(encode_scan(street_scan(0))),
           {{"Content-Type", "application/vnd.cellmap.scan"}}),
      503, "unavailable");
  EXPECT_NE(refused.find(seen["worker"].get<std::string>()), std::string::npos) << refused;
}

TEST_F(ApiFleet, AServerThatCarriesOutNoJobsTakesNoScans) {
  only_take_jobs();
  const auto refused = expect_problem(
      post("/v1/maps/town/jobs", ingest(R"("session":"drive","upload":true)")), 503, "unavailable");
  EXPECT_NE(refused.find("--role all"), std::string::npos);
  EXPECT_EQ(get("/v1/maps/town").status, 404) << "no map was made for it";
}

TEST_F(ApiFleet, AWorkerAnswersOnlyHowItIs) {
  const auto worker = server(Role::kWorker);
  const auto get = [&](const char* path) { return worker->handle({"GET", path, {}, {}, "test"}); };
  for (const char* path : {"/healthz", "/readyz", "/metrics"}) EXPECT_EQ(get(path).status, 200);
  for (const char* path : {"/v1/maps", "/v1/jobs/1", "/openapi.yaml", "/", "/nowhere"}) {
    const auto detail = expect_problem(get(path), 503, "unavailable");
    EXPECT_NE(detail.find("--role"), std::string::npos);
  }
}

TEST_F(ApiFleet, AJobOfADeadWorkerIsTakenOverWhenItsLeaseHasEnded) {
  only_take_jobs();
  const Json made = submitted("town");
  const ClaimWish dead{.worker = "dead", .lease = std::chrono::milliseconds(400)};
  ASSERT_TRUE(claims_of(*store_).claim_job(dead));
  EXPECT_EQ(job(made)["worker"], "dead");
  const auto worker = server(Role::kWorker);
  const Json ended = ended_job(made);
  EXPECT_EQ(ended["state"], "succeeded") << ended.dump();
}

TEST_F(ApiFleet, AWorkerWhoseJobWasTakenOverStopsQuietlyAndHarmsNothing) {
  const Json made = [&] {
    api_ = server(Role::kAll);
    return submitted("town", R"("session":"drive","upload":true)");
  }();
  auto& claims = claims_of(*store_);
  // As if it had been away for longer than its lease.
  std::optional<HeldJob> taken;
  while (!taken) {
    const JobClaim own{{made["id"].get<std::uint32_t>()}, 1};
    claims.extend_claim(own, std::chrono::milliseconds(1));
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
    taken = claims.claim_job({.worker = "quick", .lease = std::chrono::hours(1)});
  }
  while (job(made)["worker"] != "quick") std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_FALSE(is_final(store_->job(taken->record.id).state));
  EXPECT_EQ(submitted("village")["map"], "village") << "it goes on with others";
}

TEST_F(ApiFleet, CancellingByAnyServerReachesWhoeverCarriesTheJobOut) {
  api_ = server(Role::kAll);
  const Json made = submitted("town", R"("session":"drive","upload":true)");
  const auto at_work = std::move(api_);
  only_take_jobs();
  EXPECT_EQ(send("DELETE", "/v1/jobs/" + made["id"].dump()).status, 202);
  EXPECT_EQ(ended_job(made)["state"], "cancelled");
  expect_problem(send("DELETE", "/v1/jobs/" + made["id"].dump()), 409, "conflict");
}

TEST_F(ApiFleet, AServerThatStopsHandsItsJobsBack) {
  api_ = server(Role::kAll);
  const Json made = submitted("town", R"("session":"drive","upload":true)");
  EXPECT_FALSE(job(made)["worker"].is_null());
  api_.reset();
  only_take_jobs();
  EXPECT_TRUE(job(made)["worker"].is_null());
  EXPECT_EQ(job(made)["state"], "queued");
  const auto held = claims_of(*store_).claim_job({.worker = "next"});
  ASSERT_TRUE(held);
  EXPECT_EQ(held->holder.claim, 2u);
}

TEST_F(ApiFleet, ADriveIsNotEndedBeforeScansThatWereLostWithAServerCameAgain) {
  api_ = server(Role::kAll);
  const Json made = submitted("town", R"("session":"drive","upload":true)");
  const std::string one = "/v1/jobs/" + made["id"].dump();
  const JobId id{made["id"].get<std::uint32_t>()};
  for (std::size_t i = 0; i < 18;) {
    const auto put =
        send("PUT", one + "/scans/" + std::to_string(i), to_text(encode_scan(street_scan(i))),
             {{"Content-Type", "application/vnd.cellmap.scan"}});
    i += put.status == 204;
    ASSERT_TRUE(put.status == 204 || put.status == 503) << body_view(put);
  }
  while (store_->job(id).cells_done < 2) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  api_.reset();
  only_take_jobs();
  const JobRecord record = store_->job(id);
  const std::size_t base_scan = 7;  // of the last CELL
  ASSERT_GT(record.scans_done, base_scan);
  EXPECT_EQ(job(made)["next_scan"], base_scan);
  const auto early = send("POST", one + "/complete?scans=" + std::to_string(record.scans_done));
  expect_problem(early, 409, "conflict");
  EXPECT_EQ(json_of(early)["next_scan"], base_scan);
  EXPECT_FALSE(is_final(store_->job(id).state));
}

TEST_F(ApiFleet, DrivesOfOneMapThroughSeveralServersAreAllTiedToTheMapAsItStands) {
  make_map();
  constexpr int kServers = 3;
  constexpr std::uint32_t kCells = 8;
  std::vector<std::unique_ptr<Api>> servers;
  for (int i = 0; i < kServers; ++i) servers.push_back(server(Role::kApi));
  {
    std::vector<std::jthread> robots;
    for (int i = 0; i < kServers; ++i) {
      robots.emplace_back([&, i] {
        const std::string session = "robot" + std::to_string(i);
        for (std::uint32_t sequence = 0; sequence < kCells; ++sequence) {
          // Any server will do, also another one each time.
          const EncodedCell cell = street_cell(sequence, sequence * 6, session);
          for (int status = 503; status == 503;) {
            const auto answer = put_cell_of(*servers[(i + sequence) % kServers], session, cell);
            status = answer.status;
            ASSERT_TRUE(status == 201 || status == 503) << body_view(answer);
          }
        }
      });
    }
  }
  const PoseGraph graph = store_->pose_graph("town");
  EXPECT_EQ(graph.nodes.size(), kServers * kCells);
  EXPECT_EQ(store_->map("town").revision, kServers * kCells) << "one for each CELL";
  for (const auto& api : servers) {
    const auto told = api->handle({"GET", "/v1/maps/town/pose-graph", {}, {}, "test"});
    EXPECT_EQ(body_view(told), body_view(get("/v1/maps/town/pose-graph")));
  }
  // Each CELL is tied to the one before it, and the street was driven straight on by all.
  std::map<CellId, CellRecord> cells;
  CellQuery all;
  all.limit = 1000;
  for (int i = 0; i < kServers; ++i) {
    all.session = "robot" + std::to_string(i);
    const auto page = store_->cells("town", all).cells;
    ASSERT_EQ(page.size(), kCells);
    for (std::uint32_t k = 1; k < kCells; ++k) {
      const auto tie = std::ranges::find_if(graph.constraints, [&](const Constraint& c) {
        return c.from == page[k - 1].id && c.to == page[k].id;
      });
      ASSERT_NE(tie, graph.constraints.end());
      const Pose T = graph.nodes.at(page[k - 1].id).inverse() * graph.nodes.at(page[k].id);
      EXPECT_NEAR(T.translation().x(), 6, 0.2);
    }
  }
}

TEST_F(ApiFleet, LoopsThatSeveralServersAddAtTheSameTimeAreAllKeptAndOptimised) {
  make_map();
  put_street(6);
  const auto a = server(Role::kApi), b = server(Role::kApi);
  const auto add = [](Api& api, std::uint32_t from, std::uint32_t to) {
    Request request{"POST",
                    "/v1/maps/town/loops",
                    {},
                    R"({"from":)" + std::to_string(from) + R"(,"to":)" + std::to_string(to) +
                        R"(,"pose":[)" + std::to_string(6.0 * (to - from)) + ",0,0,0,0,0,1]}",
                    "test"};
    request.headers.set("Content-Type", "application/json");
    for (;;) {
      const auto answer = api.handle(request);
      if (answer.status == 201) return;
      ASSERT_EQ(answer.status, 503) << body_view(answer);
    }
  };
  {
    std::jthread first([&] {
      for (std::uint32_t to = 2; to <= 6; ++to) add(*a, 1, to);
    });
    std::jthread second([&] {
      for (std::uint32_t to = 3; to <= 6; ++to) add(*b, 2, to);
    });
  }
  std::size_t loops = 0;
  for (const Constraint& c : store_->pose_graph("town").constraints) {
    loops += c.kind == ConstraintKind::kLoop;
  }
  EXPECT_EQ(loops, 9u);
}

}  // namespace
}  // namespace cellmap::server::test
