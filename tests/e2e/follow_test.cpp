#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "cellmap/client/mirror.hpp"
#include "cellmap/codec/pose_grid.hpp"
#include "codec/samples.hpp"
#include "e2e/cellmapd_process.hpp"
#include "e2e/drive.hpp"
#include "support/drifting_loop.hpp"

namespace cellmap::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::uint32_t kFollowedCells = 40;

/// A real server with a drive that has not met itself again yet, and a real process that follows.
class FollowProcess : public testing::Test {
 protected:
  FollowProcess() {
    server_ = std::make_unique<CellmapdProcess>(work_ / "map.db");
    Client client = server_->client();
    client.create_map("town", {LatticeKind::kFibonacci, 1000});
    for (std::uint32_t i = 0; i < kFollowedCells; ++i) {
      Cell cell = random_cell(i, 40, 1000);
      cell.session = "drive";
      cell.sequence = i;
      client.put_cell("town", CellId{i + 1}, encode_cell(cell), loop_.drifted[i]);
    }
    for (std::uint32_t i = 0; i + 1 < kFollowedCells; ++i) {
      client.add_loop("town", CellId{i + 1}, CellId{i + 2},
                      loop_.drifted[i].inverse() * loop_.drifted[i + 1]);
    }
  }

  std::vector<std::string> pull() const {
    return {CELLMAP_PROGRAM, "pull",         "town",     mirror().string(),
            "--server",      server_->url(), "--follow", "--json"};
  }
  fs::path mirror() const { return work_ / "mirror"; }

  void close_loop(Client& client, std::uint32_t from, std::uint32_t to) {
    const Pose T = loop_.corrected[from - 1].inverse() * loop_.corrected[to - 1];
    const LoopReport report = client.add_loop("town", CellId{from}, CellId{to}, T);
    EXPECT_GT(report.moved, kFollowedCells / 2);
  }

  /// Which files of CELLs there are and when each was written.
  std::map<fs::path, fs::file_time_type> cell_files() const {
    std::map<fs::path, fs::file_time_type> files;
    for (const auto& entry : fs::directory_iterator(mirror() / "cells")) {
      files[entry.path()] = entry.last_write_time();
    }
    return files;
  }

  void expect_poses_of(Client& client) const {
    const Mirror here = read_mirror(mirror());
    const PoseGraph there = client.pose_graph("town");
    EXPECT_EQ(here.revision, there.revision);
    ASSERT_EQ(here.pose_graph.nodes.size(), there.nodes.size());
    for (const auto& [id, pose] : there.nodes) {
      const Pose& mirrored = here.pose_graph.nodes.at(id);
      EXPECT_LE((mirrored.translation() - pose.translation()).norm(), kGridTranslationError_m);
      EXPECT_LE(angle_between_rad(mirrored, pose), kGridRotationError_rad);
    }
    EXPECT_EQ(here.pose_graph.constraints.size(), there.constraints.size());
  }

  TempFolder work_;
  DriftingLoop loop_ = drifting_loop(kFollowedCells, 6.0);
  std::unique_ptr<CellmapdProcess> server_;
};

TEST_F(FollowProcess, ALoopArrivesAsPosesAndALostServerIsWaitedFor) {
  Process follower(pull(), work_ / "pull.log");
  const Json first = Json::parse(follower.read_line());
  EXPECT_EQ(first["fetched"], kFollowedCells);
  const auto files = cell_files();
  ASSERT_EQ(files.size(), kFollowedCells);

  Client client = server_->client();
  close_loop(client, kFollowedCells, 1);
  const Json update = Json::parse(follower.read_line());
  EXPECT_GT(update["moved"], kFollowedCells / 2);
  EXPECT_EQ(update["fetched"], 0);
  EXPECT_LT(update["received_bytes"], 3000);
  expect_poses_of(client);
  EXPECT_EQ(cell_files(), files);

  const int port = server_->port();
  server_->kill();
  const Json offline = cellmap_json(work_, {"info", "town", "--mirror", mirror().string()});
  EXPECT_EQ(offline["cells"], kFollowedCells);
  EXPECT_EQ(offline["revision"], update["revision"]);

  server_ = std::make_unique<CellmapdProcess>(work_ / "map.db", fs::path(), port);
  Client again = server_->client();
  close_loop(again, kFollowedCells, 2);
  const Json after = Json::parse(follower.read_line());
  EXPECT_EQ(after["fetched"], 0);
  expect_poses_of(again);
  EXPECT_EQ(cell_files(), files);
  EXPECT_EQ(follower.signal_and_wait(SIGTERM), 0);
}

TEST_F(FollowProcess, AFollowerEndsWithItsMap) {
  Process follower(pull(), work_ / "pull.log");
  EXPECT_EQ(Json::parse(follower.read_line())["fetched"], kFollowedCells);
  server_->client().delete_map("town");
  const Ended ended = follower.wait();
  EXPECT_EQ(ended.exit_code, 4) << ended.out;  // not-found
  EXPECT_EQ(read_mirror(mirror()).cells.size(), kFollowedCells);
}

}  // namespace
}  // namespace cellmap::test
