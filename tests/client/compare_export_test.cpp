#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sstream>

#include "cellmap/store/documents.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "client/cli/command_line.hpp"
#include "support/street_drive.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

/// A drive along the street on the disk, and a store with its map "town".
class CompareExportTest : public ::testing::Test {
 protected:
  CompareExportTest() {
    test::StreetDrive source(9);
    fs::create_directories(drive_ / "velodyne");
    while (const auto scan = source.next()) {
      char name[16];
      std::snprintf(name, sizeof(name), "%06zu.bin", scan->index);
      write_kitti_bin(drive_ / "velodyne" / name, scan->points);
    }
    write_trajectory(drive_ / "poses.txt", source.ground_truth(), TrajectoryFormat::kKitti);
  }

  int run(std::vector<std::string> arguments) {
    out_.str("");
    err_.str("");
    return run_command_line(arguments, out_, err_);
  }
  void build() {
    ASSERT_EQ(run({"build", drive_, "--store", store_, "--map", "town", "--lattice-size", "10000",
                   "--no-loops"}),
              0)
        << err_.str();
  }
  json exported(const std::string& what, const std::string& out,
                std::vector<std::string> more = {}) {
    std::vector<std::string> arguments = {"export", what,   "--store", store_,
                                          "--map",  "town", "--out",   folder_.path() / out,
                                          "--json"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    EXPECT_EQ(run(arguments), 0) << err_.str();
    return json::parse(out_.str(), nullptr, false);
  }

  test::TempFolder folder_;
  fs::path drive_ = folder_.path() / "drive", store_ = folder_.path() / "map.db";
  std::ostringstream out_, err_;
};

TEST_F(CompareExportTest, CompareWritesTableRowsAndReport) {
  const fs::path rows = folder_.path() / "rows.json", report = folder_.path() / "report.html";
  ASSERT_EQ(run({"compare", drive_, "--held-back", "2", "--starts", "1", "--samples", "2000",
                 "--lattice-size", "10000", "--rows", "0.4 m voxels, grid", "20 mm", "--json", rows,
                 "--html", report}),
            0)
      << err_.str();
  EXPECT_THAT(out_.str(), HasSubstr("CELLs, compact, 20 mm"));
  std::ifstream in(rows);
  const json all = json::parse(in);
  EXPECT_EQ(all["dataset"], "drive");
  EXPECT_EQ(all["scans"], 9);
  EXPECT_GE(all["rows"].size(), 4u);
  EXPECT_GT(fs::file_size(report), 1000u);
}

TEST_F(CompareExportTest, ComparePrintsRowsWhereJsonNamesNoFile) {
  ASSERT_EQ(run({"compare", drive_, "--held-back", "1", "--starts", "1", "--samples", "500",
                 "--rows", "0.4 m voxels, grid of 0.1", "--json"}),
            0)
      << err_.str();
  EXPECT_EQ(json::parse(out_.str())["rows"].size(), 1u);
}

TEST_F(CompareExportTest, CompareKeepsTheRowsWithAMap) {
  build();
  ASSERT_EQ(run({"compare", drive_, "--held-back", "1", "--starts", "1", "--samples", "500",
                 "--rows", "0.4 m voxels, grid of 0.1", "--store", store_, "--map", "town"}),
            0)
      << err_.str();
  const auto store = open_sqlite_store(store_);
  const auto kept = documents_of(*store).document("town", "comparison");
  ASSERT_TRUE(kept);
  EXPECT_EQ(json::parse(*kept)["rows"].size(), 1u);
}

TEST_F(CompareExportTest, CompareSaysWhichRowsThereAreNot) {
  EXPECT_NE(run({"compare", drive_, "--rows", "nothing of that name"}), 0);
  EXPECT_THAT(err_.str(), HasSubstr("--rows"));
}

TEST_F(CompareExportTest, ExportsTakeMorePointsAtAHigherDensity) {
  build();
  const json sparse = exported("points", "a.ply"),
             dense = exported("points", "b.las", {"--density", "25"});
  EXPECT_EQ(sparse["points"], exported("discs", "c.ply")["discs"]);
  EXPECT_GT(dense["points"], 2 * sparse["points"].get<std::uint64_t>());
  EXPECT_EQ(fs::file_size(folder_.path() / "b.las"),
            227 + 20 * dense["points"].get<std::uint64_t>());
  EXPECT_EQ(exported("tiles", "tiles", {"--tile", "10"})["points"], sparse["points"]);
  EXPECT_GT(exported("occupancy", "grid.yaml")["width"], 50);
}

TEST_F(CompareExportTest, ExportsFollowThePosesOfNow) {
  build();
  exported("points", "before.las");
  {
    const auto store = open_sqlite_store(store_);
    MapUpdate update;
    for (const auto& [id, pose] : store->pose_graph("town").nodes) {
      update.poses[id] = Eigen::Translation3d(1000, 0, 0) * pose;
    }
    store->commit("town", update);
  }
  exported("points", "after.las");
  const auto lowest_x = [&](const char* name) {
    std::ifstream in(folder_.path() / name, std::ios::binary);
    const std::string bytes(std::istreambuf_iterator<char>(in), {});
    double low = 0;  // the LAS header's "min x"
    std::memcpy(&low, bytes.data() + 187, sizeof(low));
    return low;
  };
  EXPECT_NEAR(lowest_x("after.las") - lowest_x("before.las"), 1000, 0.01);
}

TEST_F(CompareExportTest, ExportOfAnUnknownSessionSaysSo) {
  build();
  EXPECT_NE(run({"export", "discs", "--store", store_, "--map", "town", "--out",
                 folder_.path() / "d.ply", "--session", "other"}),
            0);
  EXPECT_THAT(err_.str(), HasSubstr("no CELLs"));
  EXPECT_FALSE(fs::exists(folder_.path() / "d.ply"));
}

}  // namespace
}  // namespace cellmap::cli
