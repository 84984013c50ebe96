#include "cellmap/codec/cell_json.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "cellmap/codec/cell_codec.hpp"
#include "codec/samples.hpp"

namespace cellmap {
namespace {

TEST(CellJson, EverythingOfACellIsThereExactly) {
  const Cell cell = random_cell(1, 200);
  const auto json = nlohmann::json::parse(cell_to_json(cell));
  EXPECT_EQ(json.at("hash"), to_hex(encode_cell(cell).hash));
  EXPECT_EQ(json.at("lattice").at("kind"), "fibonacci");
  EXPECT_EQ(json.at("lattice").at("size"), 50'000);
  EXPECT_EQ(json.at("session"), cell.session);
  EXPECT_EQ(json.at("sequence"), cell.sequence);
  EXPECT_EQ(json.at("first_stamp"), cell.first_stamp);
  EXPECT_EQ(json.at("last_stamp"), cell.last_stamp);
  EXPECT_EQ(json.at("first_scan"), cell.first_scan);
  EXPECT_EQ(json.at("scan_count"), cell.scan_count);
  EXPECT_EQ(json.at("statistics").at("points"), cell.statistics.points);
  EXPECT_EQ(json.at("statistics").at("rejected_grazing"), cell.statistics.rejected_grazing);
  EXPECT_EQ(json.at("indices").get<std::vector<std::uint32_t>>(), cell.indices);
  const std::array<double, 7> pose = json.at("T_odom_cell");
  EXPECT_EQ(pose, to_xyz_qxyzw(cell.T_odom_cell));
  ASSERT_EQ(json.at("planes").size(), cell.planes.size());
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const auto& numbers = json["planes"][k];
    const Plane plane = {numbers[0], numbers[1], numbers[2], numbers[3]};
    EXPECT_EQ(plane, cell.planes[k]);
  }
}

TEST(CellJson, FloatsHaveNoMoreDigitsThanTheyNeed) {
  Cell cell;
  cell.session = "s";
  cell.indices = {0};
  cell.planes = {{0.1f, 0, 0, -1}};
  const std::string json = cell_to_json(cell, ContentHash{});
  EXPECT_NE(json.find("[0.1,0.0,0.0,-1.0]"), std::string::npos) << json;
  EXPECT_NE(json.find(std::string(64, '0')), std::string::npos) << "the hash that was given";
}

}  // namespace
}  // namespace cellmap
