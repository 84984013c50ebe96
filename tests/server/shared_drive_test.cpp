#include "server/jobs/shared_drive.hpp"

#include <spdlog/sinks/ringbuffer_sink.h>

#include <future>
#include <sstream>

#include "cellmap/codec/zstd.hpp"
#include "server/jobs/ingest.hpp"
#include "server/jobs/part_helper.hpp"
#include "server/server_fixture.hpp"
#include "support/expect_error.hpp"

namespace cellmap::server::test {
namespace {

using cellmap::test::expect_error;
using namespace std::chrono_literals;

constexpr std::size_t kSharedScans = 100;  // CELLs of 3 scans: 34 of them, in 9 parts
constexpr const char* kSharedRequest =
    R"({"kind":"ingest","path":"drive","session":"drive","options":{"cell_distance_m":2}})";

/// A drive that is ingested by the holder of a job; the API is only there for its folder and store.
class SharedDrives : public ApiTest {
 protected:
  SharedDrives() {
    stop();
    store_ = open_sqlite_store(folder_.path() / "store.db");
    maps_ = std::make_unique<Maps>(*store_);
    write_drive(folder_.path() / "data" / "drive", kSharedScans);
  }
  ~SharedDrives() override { maps_.reset(); }

  Parts& parts() { return parts_of(*store_); }
  std::vector<std::filesystem::path> roots() const { return options().jobs.data_roots; }

  HeldJob claim(const std::string& map) {
    if (!made_.contains(map)) {
      store_->create_map(map, kLattice, {});
      JobRecord record;
      record.map = map;
      record.kind = "ingest";
      record.request_json = kSharedRequest;
      claims_of(*store_).queue_job(record, true, [](const auto&) { return std::nullopt; });
      made_.insert(map);
    }
    return *claims_of(*store_).claim_job({.worker = "holder", .lease = 1h});
  }

  using Meanwhile = std::function<void(const JobClaim&, const Progress&)>;

  /// Ingests into a map and ends the job; `meanwhile` is called when a CELL was committed.
  void ingest(const std::string& map, bool shared, const Meanwhile& meanwhile = {},
              int threads = 1) {
    const HeldJob job = claim(map);
    const JobClaim claim{job.record.id, job.holder.claim};
    const auto fenced = claims_of(*store_).fenced(claim);
    IngestRequest request = parse_ingest_request(parse_json(kSharedRequest));
    set_threads(request.options, threads);
    const auto source = open_request(request, roots());
    std::uint64_t scans = 0;
    const IngestHooks hooks{[&](const Progress& now) { scans = now.scans_done; },
                            [&](const Progress& now) {
                              if (meanwhile) meanwhile(claim, now);
                            }};
    std::optional<SharedJob> sharing;
    if (shared) sharing.emplace(SharedJob{parts(), claim, *log_});
    try {
      run_ingest(*maps_, *fenced, map, request, *source, stop_.get_token(), hooks, sharing);
    } catch (...) {
      claims_of(*store_).hand_back(claim);
      EXPECT_TRUE(parts().offered_parts(claim).empty());
      throw;
    }
    EXPECT_EQ(scans, kSharedScans);
    EXPECT_TRUE(parts().offered_parts(claim).empty()) << "all were collected or retracted";
    JobRecord record = job.record;
    record.state = JobState::kSucceeded;
    fenced->update_job(record);
  }

  /// All that a map is, bit by bit.
  std::string content(const std::string& map) {
    std::ostringstream text;
    text << std::hexfloat;
    const MapInfo info = store_->map(map);
    text << info.cells << ' ' << info.revision << ' ' << info.scans << ' ' << info.raw_points << ' '
         << info.voxel_points << ' ' << info.stored_bytes << '\n';
    const PoseGraph graph = store_->pose_graph(map);
    for (const auto& [id, T] : graph.nodes) {
      text << to_hex(store_->cell(map, id).hash) << ' ' << T.matrix() << '\n';
    }
    for (const Constraint& c : graph.constraints) {
      text << c.from.value << ' ' << c.to.value << ' ' << c.T_from_to.matrix() << c.information
           << c.weight << '\n';
    }
    for (const CellScans& stretch : store_->scans(map, "drive")) {
      text << stretch.raw_points << ' ' << stretch.voxel_points << '\n';
      for (const ScanInCell& scan : stretch.scans) {
        text << scan.stamp << scan.T_cell_scan.matrix() << '\n';
      }
    }
    return text.str();
  }

  void expect_the_same_as_alone(const std::string& map) {
    ingest("alone", false);
    EXPECT_EQ(store_->map("alone").cells, 34u);
    EXPECT_EQ(content(map), content("alone"));
  }

  /// What another worker would hand in for a part whose CELLs are numbered from here on.
  Bytes made(const JobPart& part, std::uint32_t first_sequence, const std::string& session) {
    const IngestRequest request = parse_ingest_request(parse_json(kSharedRequest));
    const auto source = open_request(request, roots());
    std::vector<FinishedCell> cells;
    make_part(*source,
              FrontEnd(request.options, session, std::make_shared<const Lattice>(kLattice)),
              {first_sequence, part.first_scan, part.scan_count},
              [&](FinishedCell&& cell) {
                cells.push_back(std::move(cell));
                return true;
              },
              {});
    return pack_part(cells);
  }

  std::unique_ptr<PartHelper> helper(std::vector<std::filesystem::path> data_roots) {
    return std::make_unique<PartHelper>(
        *maps_, metrics_, log_,
        PartHelperOptions{"helper", std::move(data_roots), 1, [] { return true; }});
  }

  void wait_until(const std::function<bool()>& is_true) {
    for (int i = 0; i < 2000 && !is_true(); ++i) std::this_thread::sleep_for(5ms);
    EXPECT_TRUE(is_true());
  }
  bool are_all_made(const JobClaim& claim) {
    const auto offered = parts().offered_parts(claim);
    return !offered.empty() && std::ranges::all_of(offered, &JobPartState::is_made);
  }

  std::string said() {
    std::string all;
    for (const std::string& line : sink_->last_formatted()) all += line;
    return all;
  }

  std::unique_ptr<Maps> maps_;
  std::set<std::string> made_;
  Metrics metrics_;
  std::shared_ptr<spdlog::sinks::ringbuffer_sink_mt> sink_ =
      std::make_shared<spdlog::sinks::ringbuffer_sink_mt>(100);
  std::shared_ptr<spdlog::logger> log_ = std::make_shared<spdlog::logger>("test", sink_);
  std::stop_source stop_;
};

TEST_F(SharedDrives, WithoutHelpTheMapIsTheSame) {
  ingest("town", true);
  ingest("ahead", true, {}, 2);
  expect_the_same_as_alone("town");
  EXPECT_EQ(content("ahead"), content("alone"));
  EXPECT_EQ(said(), "");
}

TEST_F(SharedDrives, WhatAnotherWorkerMakesIsTheSameBitByBit) {
  const auto helps = helper(roots());
  std::size_t most = 0;
  ingest("town", true, [&](const JobClaim& claim, const Progress& now) {
    if (now.cells_done % 4 == 1 && now.cells_done < 32)
      wait_until([&] { return are_all_made(claim); });
    most = std::max(most, parts().offered_parts(claim).size());
  });
  expect_the_same_as_alone("town");
  EXPECT_NE(metrics_.text({}).find("cellmap_parts_made_total 8"), std::string::npos)
      << "all but the first one\n"
      << said();
  EXPECT_GT(most, 2u) << "more are offered when somebody helps";
  EXPECT_LE(most, 6u);
  EXPECT_EQ(said(), "");
}

TEST_F(SharedDrives, AWorkerThatDiesWithAPartCostsOnlyTime) {
  ingest("town", true, [&](const JobClaim& claim, const Progress& now) {
    if (now.cells_done > 9) return;
    while (parts().take_part(claim.job, "dies")) {
    }
  });
  EXPECT_NE(said().find("dies is slow or gone"), std::string::npos);
  expect_the_same_as_alone("town");
}

TEST_F(SharedDrives, AWorkerThatWasGivenUpDeliversInVain) {
  std::optional<JobPart> late;
  ingest("town", true, [&](const JobClaim& claim, const Progress& now) {
    if (now.cells_done == 1) late = parts().take_part(claim.job, "slow");
    if (now.cells_done == 20) {
      EXPECT_FALSE(parts().deliver_part(*late, "slow", made(*late, 4, "drive")));
    }
  });
  expect_the_same_as_alone("town");
}

TEST_F(SharedDrives, PartsThatAreDamagedOrOfAnotherDriveAreMadeAgainByTheHolder) {
  int delivered = 0;
  ingest("town", true, [&](const JobClaim& claim, const Progress&) {
    while (const auto part = parts().take_part(claim.job, "bad")) {
      const std::uint32_t first = part->first_sequence;
      Bytes bytes;
      switch (delivered++ % 5) {
        case 0:
          bytes.resize(1000);
          break;
        case 1:
          bytes = zstd_compress(Bytes(1000));
          break;
        case 2:
          bytes = made(*part, first + 1, "drive");
          break;
        case 3:
          bytes = made(*part, first, "other");
          break;
        default:
          bytes = made(*part, first, "drive");  // good
      }
      EXPECT_TRUE(parts().deliver_part(*part, "bad", bytes));
    }
  });
  EXPECT_EQ(delivered, 8);
  for (const char* why :
       {"made again here", "identifier", "the stretch of a CELL", "the session"}) {
    EXPECT_NE(said().find(why), std::string::npos) << why << "\n" << said();
  }
  expect_the_same_as_alone("town");
}

TEST_F(SharedDrives, AWorkerThatDoesNotSeeTheDriveGivesPartsBackAndLeavesTheJobAlone) {
  std::filesystem::create_directories(folder_.path() / "elsewhere");
  const auto helps = helper({std::filesystem::canonical(folder_.path() / "elsewhere")});
  ingest("town", true, [&](const JobClaim&, const Progress& now) {
    if (now.cells_done != 1) return;
    wait_until([&] { return said().find("no help from here") != std::string::npos; });
  });
  expect_the_same_as_alone("town");
  EXPECT_NE(metrics_.text({}).find("cellmap_parts_made_total 0"), std::string::npos);
}

TEST_F(SharedDrives, AfterATakeoverAnotherWorkerGoesOnWithHelp) {
  const auto helps = helper(roots());
  for (const bool shared : {true, false}) {
    const std::string map = shared ? "town" : "alone";
    const auto stop_at_10 = [&](const JobClaim& claim, const Progress& now) {
      if (shared && now.cells_done == 2) wait_until([&] { return are_all_made(claim); });
      if (now.cells_done == 10) stop_.request_stop();
    };
    expect_error(ErrorCode::kCancelled, [&] { ingest(map, shared, stop_at_10); });
    EXPECT_EQ(store_->map(map).cells, 10u);
    EXPECT_TRUE(parts().jobs_with_parts().empty());
    stop_ = {};
    ingest(map, shared);
  }
  EXPECT_EQ(content("town"), content("alone"));
}

TEST_F(SharedDrives, TwoServersOverOneStoreEndEachOthersDrivesWithTheSameBytes) {
  ApiOptions both = options();
  both.jobs.workers = 1;
  Api one(*store_, both), two(*store_, both);
  std::vector<Json> jobs;
  for (const char* map : {"town", "village"}) {
    store_->create_map(map, kLattice, {});
    Request request{"POST", std::string("/v1/maps/") + map + "/jobs", {}, kSharedRequest, "test"};
    request.headers.set("Content-Type", "application/json");
    const Response response = one.handle(request);
    ASSERT_EQ(response.status, 202) << body_view(response);
    jobs.push_back(json_of(response));
  }
  for (const Json& job : jobs) {
    const JobId id{job.at("id").get<std::uint32_t>()};
    wait_until([&] { return is_final(store_->job(id).state); });
    EXPECT_EQ(store_->job(id).state, JobState::kSucceeded);
    EXPECT_EQ(store_->job(id).scans_done, kSharedScans);
  }
  EXPECT_TRUE(parts().jobs_with_parts().empty());
  one.stop();
  two.stop();
  expect_the_same_as_alone("town");
  EXPECT_EQ(content("village"), content("town"));
}

TEST_F(SharedDrives, ACancelledJobLeavesNoParts) {
  ApiOptions slow = options();
  Api one(*store_, slow);
  store_->create_map("town", kLattice, {});
  Request request{"POST", "/v1/maps/town/jobs", {}, kSharedRequest, "test"};
  request.headers.set("Content-Type", "application/json");
  const Json job = json_of(one.handle(request));
  const JobId id{job.at("id").get<std::uint32_t>()};
  wait_until([&] { return store_->job(id).cells_done > 0; });
  one.handle({"DELETE", "/v1/jobs/" + job.at("id").dump(), {}, {}, "test"});
  wait_until([&] { return is_final(store_->job(id).state); });
  EXPECT_TRUE(parts().offered_parts({id, 1}).empty());
}

}  // namespace
}  // namespace cellmap::server::test
