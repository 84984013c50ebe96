#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "cellmap/client/mirror.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "codec/samples.hpp"
#include "e2e/cellmapd_process.hpp"
#include "e2e/drive.hpp"

// Maps that keep their CELLs coded, through the programs: build, ingest, convert, pull, verify.

namespace cellmap::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class KeptCells : public testing::Test {
 protected:
  KeptCells() {
    const Ended ended = cellmap_program(work_, simulate_arguments(drive(), 30));
    EXPECT_EQ(ended.exit_code, 0) << ended.out;
  }
  std::string drive() const { return (work_ / "drive").string(); }
  std::string file(const std::string& name) const { return (work_ / name).string(); }
  Json run(std::vector<std::string> arguments) const { return cellmap_json(work_, arguments); }
  static std::uintmax_t bytes_in(const fs::path& folder) {
    std::uintmax_t bytes = 0;
    for (const auto& entry : fs::directory_iterator(folder)) bytes += entry.file_size();
    return bytes;
  }

  TempFolder work_;
};

TEST_F(KeptCells, AMapIsBuiltCompactVerifiedArchivedAndRestored) {
  const std::vector<std::string> build{"build", drive(), "--map", "town", "--cell-distance", "4"};
  const auto into = [&](const std::string& store, std::vector<std::string> form) {
    std::vector<std::string> arguments = build;
    arguments.insert(arguments.end(), {"--store", file(store)});
    arguments.insert(arguments.end(), form.begin(), form.end());
    return run(arguments);
  };
  const Json raw = into("raw.db", {});
  const Json compact = into("compact.db", {"--encoding", "compact", "--bound", "20mm"});
  EXPECT_EQ(raw["encoding"], "raw");
  EXPECT_EQ(compact["encoding"], "compact");
  EXPECT_EQ(compact["cells"], raw["cells"]);
  EXPECT_EQ(compact["planes"], raw["planes"]);
  EXPECT_LT(compact["stored_bytes"].get<double>(), raw["stored_bytes"].get<double>() / 5);

  const Json verified =
      run({"verify", file("compact.db"), "--map", "town", "--source", file("raw.db")});
  EXPECT_EQ(verified["cells"], raw["cells"]);
  EXPECT_EQ(verified["source"]["different"], 0);
  EXPECT_LE(verified["source"]["worst_m"], 0.02);
  EXPECT_GT(verified["source"]["p99_m"], verified["source"]["median_m"]);

  const Json archived =
      run({"archive", "town", "--store", file("compact.db"), "--out", file("town.cellmap")});
  EXPECT_EQ(archived["encoding"], "compact");
  EXPECT_EQ(
      run({"verify", file("town.cellmap"), "--source", file("compact.db")})["source"]["equal"],
      raw["cells"]);
  const Json restored =
      run({"restore", file("town.cellmap"), "--store", file("restored.db"), "--map", "town"});
  EXPECT_EQ(restored["encoding"], "compact");
  EXPECT_EQ(restored["stored_bytes"], compact["stored_bytes"]);
  EXPECT_EQ(run({"cells", "town", "--store", file("restored.db")})["cells"][0]["hash"],
            run({"cells", "town", "--store", file("compact.db")})["cells"][0]["hash"]);
}

TEST_F(KeptCells, AFollowerOverAThinLinkGetsTheKeptBytesAndRelocalisesWithThem) {
  CellmapdProcess server(work_ / "map.db");
  const Json made = run({"maps", "create", "town", "--encoding", "compact", "--bound", "20mm",
                         "--server", server.url()});
  EXPECT_EQ(made["encoding"], "compact");
  const Json ingested =
      run({"ingest", drive(), "--map", "town", "--cell-distance", "4", "--server", server.url()});
  ASSERT_EQ(ingested["map"]["kept"].size(), 1u) << ingested.dump();
  const Json pulled = run({"pull", "town", file("mirror"), "--server", server.url()});
  EXPECT_EQ(pulled["held"], ingested["map"]["cells"]);
  EXPECT_LT(pulled["received_bytes"].get<double>(),
            ingested["map"]["encoded_bytes"].get<double>() / 5);
  EXPECT_LT(bytes_in(work_ / "mirror/cells"),
            ingested["map"]["encoded_bytes"].get<std::uintmax_t>() / 5);
  server.stop();
  const Mirror mirror = read_mirror(work_ / "mirror");
  for (const auto& [id, record] : mirror.cells) {
    const auto cell = read_mirrored_cell(work_ / "mirror", record.hash);
    ASSERT_TRUE(cell);
    EXPECT_EQ(cell->hash, record.hash) << "the map's own CELL to the bit";
  }
  const Json found = run({"relocalise", (work_ / "drive/velodyne/000012.bin").string(), "--map",
                          "town", "--mirror", file("mirror")});
  EXPECT_EQ(found["found"], true) << found.dump();
}

TEST_F(KeptCells, AMapThatIsConvertedReachesItsFollowersAsOtherCells) {
  CellmapdProcess server(work_ / "map.db");
  run({"ingest", drive(), "--map", "town", "--cell-distance", "4", "--server", server.url()});
  const Json thin = run({"pull", "town", file("thin"), "--server", server.url(), "--encoding",
                         "compact", "--bound", "20mm"});
  const Json whole = run({"pull", "town", file("whole"), "--server", server.url()});
  EXPECT_LT(thin["fetched_bytes"].get<double>(), whole["fetched_bytes"].get<double>() / 5);
  const Json again = run({"pull", "town", file("thin"), "--server", server.url(), "--encoding",
                          "compact", "--bound", "20mm"});
  EXPECT_EQ(again["fetched"], 0);

  const Json converted = run({"maps", "convert", "town", "--encoding", "compact", "--bound", "20mm",
                              "--server", server.url()});
  EXPECT_EQ(converted["encoding"], "compact");
  const Json told = run({"pull", "town", file("whole"), "--server", server.url()});
  EXPECT_EQ(told["fetched"], converted["cells"]);
  EXPECT_LT(told["fetched_bytes"].get<double>(), whole["fetched_bytes"].get<double>() / 5);
  EXPECT_LT(bytes_in(work_ / "whole/cells"), whole["fetched_bytes"].get<std::uintmax_t>() / 5);
  const Ended refused = cellmap_program(
      work_, {"maps", "convert", "town", "--encoding", "raw", "--server", server.url()});
  EXPECT_NE(refused.exit_code, 0);
  const Json fetched = run(
      {"fetch", "town", "1", "--server", server.url(), "--encoding", "compact", "--bound", "50mm"});
  EXPECT_DOUBLE_EQ(fetched["bound_m"], 0.02);
}

}  // namespace
}  // namespace cellmap::test
