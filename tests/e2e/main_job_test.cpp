#include <gmock/gmock.h>

#include <fstream>
#include <iterator>
#include <thread>

#include "cellmap/client/mirror.hpp"
#include "e2e/cellmapd_process.hpp"
#include "e2e/drive.hpp"

namespace cellmap::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr int kDriveScans = 90;

std::string read_text(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::string row(const fs::path& file, int number) {
  std::ifstream stream(file);
  std::string line;
  for (int i = 0; i <= number; ++i) std::getline(stream, line);
  return line;
}

/// Content hashes in order of the drive.
std::vector<std::string> hashes(Client& client, const std::string& map) {
  std::vector<std::string> hashes;
  for (const CellRecord& cell : client.all_cells(map)) {
    EXPECT_EQ(cell.sequence, hashes.size());
    hashes.push_back(to_hex(cell.hash));
  }
  return hashes;
}

/// One drive, one server and one map for all tests: made once, in about ten seconds.
class MainJob : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    work_ = std::make_unique<TempFolder>();
    auto simulate = simulate_arguments(drive(), kDriveScans);
    simulate.insert(simulate.end(), {"--odometry", "truth"});
    cellmap_json(*work_, simulate);
    simulate = simulate_arguments((*work_ / "query").string(), 40);
    simulate.insert(simulate.end(), {"--odometry", "truth", "--lateral-offset", "0.5"});
    cellmap_json(*work_, simulate);
    server_ = std::make_unique<CellmapdProcess>(*work_ / "map.db", work_->path());
    ingest_ = cellmap_json(*work_, {"ingest", drive(), "--server", server_->url(), "--map", "town",
                                    "--session", "monday"});
  }
  static void TearDownTestSuite() {
    if (server_) {
      EXPECT_EQ(server_->stop(), 0);
    }
    server_.reset();
    work_.reset();
  }

  static std::string drive() { return (*work_ / "drive").string(); }
  static std::vector<std::string> at_town(std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--server", server_->url(), "--map", "town"});
    return arguments;
  }

  static inline std::unique_ptr<TempFolder> work_;
  static inline std::unique_ptr<CellmapdProcess> server_;
  static inline nlohmann::json ingest_;
};

TEST_F(MainJob, AnUploadedDriveBecomesAMap) {
  EXPECT_EQ(ingest_["job"]["state"], "succeeded");
  EXPECT_EQ(ingest_["job"]["scans_done"], kDriveScans);
  const auto info = cellmap_json(*work_, {"info", "town", "--server", server_->url()});
  EXPECT_EQ(info["scans"], kDriveScans);
  EXPECT_GT(info["cells"], 3);
  EXPECT_GT(info["planes"], 1000);
  EXPECT_GT(info["voxel_points"], 0);
  EXPECT_LT(info["stored_bytes"], info["raw_bytes"]);
  EXPECT_EQ(info["sessions"], nlohmann::json::array({"monday"}));
}

TEST_F(MainJob, ThePathOnTheServerGivesTheSameCellsAsTheUpload) {
  cellmap_json(*work_, {"ingest", drive(), "--server-path", "--server", server_->url(), "--map",
                        "by-path", "--session", "monday"});
  Client client = server_->client();
  EXPECT_EQ(hashes(client, "by-path"), hashes(client, "town"));
}

TEST_F(MainJob, BuildingWithoutAServerGivesTheSameCellsAndGoesNoFurtherTheSecondTime) {
  const std::string store = (*work_ / "offline.db").string();
  const std::vector<std::string> build = {"build", drive(), "--store",   store,
                                          "--map", "town",  "--session", "monday"};
  const auto built = cellmap_json(*work_, build);
  Client client = server_->client();
  std::vector<std::string> offline;
  const auto cells = cellmap_json(*work_, {"cells", "town", "--store", store});
  for (const auto& cell : cells["cells"]) offline.push_back(cell["hash"]);
  EXPECT_EQ(offline, hashes(client, "town"));
  EXPECT_EQ(cellmap_json(*work_, build)["revision"], built["revision"]);
}

TEST_F(MainJob, IngestingTheSameSessionAgainChangesNothing) {
  Client client = server_->client();
  const Revision before = client.map("town").revision;
  const auto again = cellmap_json(*work_, {"ingest", drive(), "--server", server_->url(), "--map",
                                           "town", "--session", "monday"});
  EXPECT_EQ(again["job"]["state"], "succeeded");
  EXPECT_EQ(client.map("town").revision, before);
}

TEST_F(MainJob, ACellIsSentOnceAndConfirmedAfterwards) {
  Client client = server_->client(*work_ / "cache");
  const CellId id = client.all_cells("town").front().id;
  const FetchedCell first = client.cell("town", id);
  EXPECT_FALSE(first.from_cache);
  const FetchedCell second = client.cell("town", id);
  EXPECT_TRUE(second.from_cache);
  EXPECT_EQ(second.encoded.bytes, first.encoded.bytes);
  const auto fetched =
      cellmap_json(*work_, {"fetch", "town", std::to_string(id.value), "--server", server_->url(),
                            "--out", (*work_ / "one.cell").string()});
  EXPECT_EQ(fetched["hash"], to_hex(first.encoded.hash));
  EXPECT_EQ(read_text(*work_ / "one.cell").size(), first.encoded.bytes.size());
}

TEST_F(MainJob, AScanBesideTheDrivenLineIsFoundWithAndWithoutAPrior) {
  const std::string scan = (*work_ / "query" / "velodyne" / "000030.bin").string();
  const std::string truth = row(*work_ / "query" / "poses_gt.txt", 30);
  const auto anywhere = cellmap_json(*work_, at_town({"relocalise", scan, "--truth-row", truth}));
  ASSERT_TRUE(anywhere["found"].get<bool>()) << anywhere;
  EXPECT_LT(anywhere["error_m"], 0.3);
  EXPECT_LT(anywhere["error_deg"], 1.0);
  std::string prior;
  for (std::size_t i = 0; i < 7; ++i) {
    const double off = i == 0 ? 1.5 : 0;  // a prior that is wrong by 1.5 m
    prior += std::to_string(anywhere["T_map_scan"][i].get<double>() + off) + " ";
  }
  const auto near = cellmap_json(*work_, at_town({"relocalise", scan, "--truth-row", truth,
                                                  "--prior", prior, "--radius", "5"}));
  ASSERT_TRUE(near["found"].get<bool>()) << near;
  EXPECT_LT(near["error_m"], 0.3);
  EXPECT_LE(near["cells_considered"], anywhere["cells_considered"]);
}

TEST_F(MainJob, RelocalisingInTheStoreAgreesWithTheTruthToo) {
  const std::string store = (*work_ / "reloc.db").string();
  cellmap_json(*work_, {"build", drive(), "--store", store, "--map", "town"});
  const auto answer = cellmap_json(
      *work_, {"relocalise", (*work_ / "query" / "velodyne" / "000030.bin").string(), "--store",
               store, "--map", "town", "--truth-row", row(*work_ / "query" / "poses_gt.txt", 30)});
  ASSERT_TRUE(answer["found"].get<bool>()) << answer;
  EXPECT_LT(answer["error_m"], 0.3);
}

TEST_F(MainJob, LoopsAreAddedListedAndTakenBack) {
  Client client = server_->client();
  const std::vector<CellRecord> cells = client.all_cells("town");
  const CellRecord &from = cells.front(), &to = cells.back();
  const Pose T_from_to = from.T_map_cell.inverse() * to.T_map_cell;
  const std::size_t before = client.loops("town").loops.size();
  const LoopReport added = client.add_loop("town", from.id, to.id, T_from_to);
  ASSERT_EQ(added.loops.size(), 1u);
  EXPECT_EQ(added.loops[0].origin, ConstraintOrigin::kUser);
  EXPECT_EQ(client.loop("town", added.loops[0].id).constraint.to, to.id);
  EXPECT_EQ(
      cellmap_json(*work_, {"loops", "list", "town", "--server", server_->url()})["loops"].size(),
      before + 1);
  cellmap_json(
      *work_, {"loops", "detect", "town", std::to_string(to.id.value), "--server", server_->url()});
  client.delete_loop("town", added.loops[0].id);
  EXPECT_THROW(client.loop("town", added.loops[0].id), Error);
}

TEST_F(MainJob, AMapIsCopiedPlacedDividedAndItsLoopsExplained) {
  const auto ask = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.end(), {"--server", server_->url()});
    return cellmap_json(*work_, arguments);
  };
  ask({"maps", "create", "copy"});
  const auto merged = ask({"merge", "copy", "--from", "town", "--sessions", "monday"});
  EXPECT_EQ(merged["job"]["state"], "succeeded");
  Client client = server_->client();
  EXPECT_EQ(hashes(client, "copy"), hashes(client, "town"));

  const auto placed =
      ask({"maps", "georeference", "copy", "--origin", "49,8.4,110", "--heading", "0"});
  EXPECT_EQ(placed["georeference"]["latitude_deg"], 49);
  const CellRecord last = client.all_cells("copy").back();
  const std::string file = (*work_ / "last.cell").string();
  ask({"fetch", "copy", std::to_string(last.id.value), "--out", file});
  const auto found = ask({"relocalise", file, "--map", "copy"});
  ASSERT_EQ(found["found"], true) << found;
  // A heading of 0: the map's x axis points north.
  EXPECT_NEAR(found["geopose"]["position"]["lat"].get<double>(),
              49 + last.T_map_cell.translation().x() / 111'207, 1e-6);

  const LoopReport added =
      client.add_loop("copy", CellId{1}, last.id, client.all_cells("copy").front().T_map_cell);
  const std::string loop = std::to_string(added.loops.at(0).id.value);
  EXPECT_EQ(ask({"loops", "pin", "copy", loop})["loops"][0]["verdict"], "pinned");
  EXPECT_EQ(ask({"loops", "show", "copy", loop})["pinned"], true);
  EXPECT_EQ(ask({"loops", "unpin", "copy", loop})["loops"][0]["pinned"], false);

  EXPECT_EQ(ask({"split", "copy", "--sessions", "monday", "--into", "attic"})["cells"],
            hashes(client, "town").size());
  EXPECT_EQ(ask({"info", "copy"})["cells"], 0);
  EXPECT_TRUE(ask({"sessions", "attic", "--delete", "monday"})["sessions"].empty());
  EXPECT_TRUE(ask({"maps", "georeference", "copy", "--clear"})["georeference"].is_null());
  ask({"maps", "delete", "copy"});
  ask({"maps", "delete", "attic"});
}

TEST_F(MainJob, AMirrorHasEveryCellAndTheSecondPullFetchesNothing) {
  const std::vector<std::string> pull = {"pull",         "town",  "--server",
                                         server_->url(), "--out", (*work_ / "mirror").string()};
  Client client = server_->client();
  const auto first = cellmap_json(*work_, pull);
  EXPECT_EQ(first["fetched"], client.map("town").cells);
  EXPECT_EQ(cellmap_json(*work_, pull)["fetched"], 0);
  const Mirror mirror = read_mirror(*work_ / "mirror");
  const PoseGraph graph = client.pose_graph("town");
  EXPECT_EQ(mirror.pose_graph.constraints.size(), graph.constraints.size());
  ASSERT_EQ(mirror.pose_graph.nodes.size(), graph.nodes.size());
  for (const auto& [id, pose] : graph.nodes) {
    EXPECT_TRUE(mirror.pose_graph.nodes.at(id).isApprox(pose, 1e-9)) << id.value;
  }
}

TEST_F(MainJob, AMirrorAnswersWithoutItsServer) {
  const std::string mirror = (*work_ / "offline-mirror").string();
  const auto pulled = cellmap_json(*work_, {"pull", "town", mirror, "--server", server_->url()});
  const auto info = cellmap_json(*work_, {"info", "town", "--mirror", mirror});
  EXPECT_EQ(info["cells"], pulled["cells"]);
  EXPECT_EQ(info["revision"], pulled["revision"]);
  const auto answer = cellmap_json(
      *work_, {"relocalise", (*work_ / "query" / "velodyne" / "000030.bin").string(), "--mirror",
               mirror, "--map", "town", "--truth-row", row(*work_ / "query" / "poses_gt.txt", 30)});
  ASSERT_TRUE(answer["found"].get<bool>()) << answer;
  EXPECT_LT(answer["error_m"], 0.3);
  EXPECT_EQ(answer["revision"], pulled["revision"]);
}

TEST_F(MainJob, ExportsAreReadByOthersAndTheTrajectoryIsRight) {
  const std::string graph = (*work_ / "town.g2o").string();
  cellmap_json(*work_, at_town({"export", "graph", "--out", graph}));
  EXPECT_THAT(read_text(graph), HasSubstr("VERTEX_SE3:QUAT"));
  EXPECT_THAT(read_text(graph), HasSubstr("EDGE_SE3:QUAT"));
  for (const std::string stage : {"odometry", "optimised"}) {
    const std::string file = (*work_ / (stage + ".txt")).string();
    const auto exported = cellmap_json(*work_, at_town({"export", "trajectory", "--format", "kitti",
                                                        "--stage", stage, "--out", file}));
    EXPECT_EQ(exported["rows"], kDriveScans);
    const auto errors = cellmap_json(*work_, {"evaluate", "trajectory", "--estimate", file,
                                              "--truth", drive() + "/poses_gt.txt"});
    EXPECT_EQ(errors["poses"], kDriveScans);
    EXPECT_LT(errors["ape_rmse_m"], 0.1) << stage;
  }
  const Ended cloud = cellmap_program(
      *work_, at_town({"export", "cloud", "--out", (*work_ / "town.ply").string()}));
  if (cloud.exit_code == 9) GTEST_SKIP() << "built without PCL";
  EXPECT_EQ(cloud.exit_code, 0);
  EXPECT_EQ(read_text(*work_ / "town.ply").substr(0, 3), "ply");
}

TEST_F(MainJob, AKilledServerResumesTheIngestAndTheMapIsTheSame) {
  const fs::path store = *work_ / "killed.db";
  const auto ingest = [&](const CellmapdProcess& server) {
    return std::vector<std::string>{CELLMAP_PROGRAM, "ingest",      drive(), "--server",
                                    server.url(),    "--map",       "town",  "--session",
                                    "monday",        "--reconnect", "0",     "--json"};
  };
  {
    CellmapdProcess server(store);
    Process sending(ingest(server), *work_ / "cellmap.log");
    Client client = server.client();
    for (bool enough = false; !enough; std::this_thread::sleep_for(std::chrono::milliseconds(5))) {
      try {
        enough = client.map("town").cells >= 3;
      } catch (const Error& error) {
        ASSERT_EQ(error.code(), ErrorCode::kNotFound) << error.what();  // not made yet
      }
    }
    server.kill();
    EXPECT_NE(sending.wait().exit_code, 0);
  }
  CellmapdProcess server(store);
  Client client = server.client();
  const std::uint64_t kept = client.map("town").cells;
  EXPECT_GE(kept, 3u);
  const Ended resumed = Process(ingest(server), *work_ / "cellmap.log").wait();
  ASSERT_EQ(resumed.exit_code, 0) << resumed.out;
  Client undisturbed = server_->client();
  EXPECT_EQ(hashes(client, "town"), hashes(undisturbed, "town"));
  EXPECT_LT(kept, client.map("town").cells) << "the kill came too late to prove anything";
  EXPECT_EQ(server.stop(), 0);
}

}  // namespace
}  // namespace cellmap::test
