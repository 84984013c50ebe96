// Archives with JSON twins, made without the library (tests/conformance/generate_archive.py).

#include <gmock/gmock.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/verify_archive.hpp"

namespace cellmap {
namespace {

using Json = nlohmann::json;

const std::filesystem::path kFolder =
    std::filesystem::path(CELLMAP_SOURCE_DIR) / "tests" / "conformance" / "v1";

Eigen::Matrix4d matrix_of(const Json& json) {
  constexpr std::array kNames = {"r00", "r01", "r02", "tx",  "r10", "r11",
                                 "r12", "ty",  "r20", "r21", "r22", "tz"};
  Eigen::Matrix4d M = Eigen::Matrix4d::Identity();
  for (int i = 0; i < 12; ++i) M(i / 4, i % 4) = json.at(kNames[i]);
  return M;
}

class ArchiveConformance : public testing::TestWithParam<const char*> {
 protected:
  std::filesystem::path file() const { return kFolder / (std::string(GetParam()) + ".cellmap"); }
  Json twin() const {
    std::ifstream stream(file().string() + ".json");
    return Json::parse(stream);
  }
};

TEST_P(ArchiveConformance, HoldsWhatItsTwinSays) {
  const Json twin = this->twin();
  ArchiveReader reader(open_file(file(), FileMode::kRead));
  EXPECT_EQ(reader.footer().map, twin["map"]);
  EXPECT_EQ(reader.footer().created, twin["created_ns"]);
  EXPECT_EQ(reader.head().lattice.size, twin["lattice_size"]);
  EXPECT_EQ(reader.footer().revision, twin["revision"]);
  EXPECT_EQ(reader.pose_graph().revision, twin["revision"]);
  EXPECT_EQ(reader.pose_graph().constraints.size(), twin["constraints"]);
  EXPECT_EQ(reader.pose_graph().unaligned.size(), twin.value("unaligned", Json::array()).size());
  const auto& place = *reader.footer().georeference;
  EXPECT_EQ(place.latitude_deg, twin["georeference"]["latitude_deg"]);
  EXPECT_EQ(place.R_enu_map, (matrix_of(twin["georeference"]["t_enu_map"]).topLeftCorner<3, 3>()));
  ASSERT_EQ(reader.footer().sessions.size(), twin["sessions"].size());
  for (std::size_t i = 0; i < twin["sessions"].size(); ++i) {
    EXPECT_EQ(reader.footer().sessions[i].name, twin["sessions"][i]["name"]);
    EXPECT_EQ(reader.footer().sessions[i].sensor, twin["sessions"][i].value("sensor", ""));
    EXPECT_EQ(reader.footer().sessions[i].started, twin["sessions"][i].value("started_ns", 0ll));
  }
}

TEST_P(ArchiveConformance, EveryCellIsThatOfItsTwin) {
  const Json twin = this->twin();
  ArchiveReader reader(open_file(file(), FileMode::kRead));
  ASSERT_EQ(reader.cells().size(), twin["cells"].size());
  for (std::size_t i = 0; i < twin["cells"].size(); ++i) {
    const Json& expected = twin["cells"][i];
    const CellId id{expected["id"]};
    const ArchivedCell listed = reader.cells()[i];
    EXPECT_EQ(listed.id, id);
    EXPECT_EQ(listed.bytes, expected["bytes"]);
    const ArchiveCell cell = reader.cell(id);
    EXPECT_EQ(to_hex(listed.hash), expected["hash"]);
    EXPECT_EQ(to_hex(cell.raw_hash), expected["hash"]);
    EXPECT_EQ(cell.cell.session, expected["session"]);
    EXPECT_EQ(cell.cell.sequence, expected["sequence"]);
    EXPECT_EQ(cell.cell.planes.size(), expected["planes"]);
    EXPECT_EQ(reader.pose_graph().nodes.at(id).matrix(), matrix_of(expected["t_map_cell"]));
  }
  ASSERT_EQ(reader.scans().size(), twin["scans"].size());
  for (const Json& expected : twin["scans"]) {
    const CellScans& stretch = reader.scans().at(CellId{expected["id"]});
    EXPECT_EQ(stretch.raw_points, expected["raw_points"]);
    EXPECT_EQ(stretch.voxel_points, expected["voxel_points"]);
    EXPECT_EQ(stretch.T_odom_cell.matrix(), matrix_of(expected["t_odom_cell"]));
    ASSERT_EQ(stretch.scans.size(), expected["scans"].size());
    for (std::size_t i = 0; i < stretch.scans.size(); ++i) {
      EXPECT_EQ(stretch.scans[i].stamp, expected["scans"][i]["stamp_ns"]);
      EXPECT_EQ(stretch.scans[i].T_cell_scan.matrix(),
                matrix_of(expected["scans"][i]["t_cell_scan"]));
    }
  }
}

TEST_P(ArchiveConformance, IsIntactByteForByte) {
  const auto source = open_file(file(), FileMode::kRead);
  const auto damage = verify_archive(*source).damage;
  if (std::string(GetParam()) == "half-updated") {
    EXPECT_THAT(damage, testing::ElementsAre(testing::HasSubstr("not finished")));
  } else {
    EXPECT_THAT(damage, testing::IsEmpty());
  }
}

INSTANTIATE_TEST_SUITE_P(V1, ArchiveConformance,
                         testing::Values("three-cells", "with-leaves", "updated", "half-updated"),
                         [](const auto& info) {
                           std::string name = info.param;
                           std::erase(name, '-');
                           return name;
                         });

}  // namespace
}  // namespace cellmap
