// The folder that the paper's released code writes; the one in tests/conformance was made without
// the library (generate_released_folder.py).
#include "cellmap/codec/released_folder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <random>

#include "cellmap/core/error.hpp"
#include "cellmap/scan/text_table.hpp"
#include "codec/raw_buffer.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

const fs::path kVectors = fs::path(CELLMAP_SOURCE_DIR) / "tests/conformance/v1";

ReleasedFolderOptions small_bands() {
  ReleasedFolderOptions options;
  options.lattice.size = 1'000;
  return options;
}

/// A copy of the folder that a test may spoil.
class FolderCopy {
 public:
  FolderCopy() { fs::copy(kVectors / "released-folder", path()); }
  fs::path path() const { return temporary_ / "map"; }
  void write(const std::string& name, const std::string& text) const {
    write_file(path() / name, text);
  }
  std::string read(const std::string& name) const { return read_file(path() / name, 1 << 20); }
  std::optional<Thrown> error() const {
    return thrown_by([&] {
      const ReleasedFolder folder(path(), small_bands());
      for (std::size_t k = 0; k < folder.size(); ++k) folder.read(k);
    });
  }

 private:
  test::TempFolder temporary_;
};

TEST(ReleasedFolder, IsReadAsItsTwinSays) {
  const ReleasedFolder folder(kVectors / "released-folder", small_bands());
  const auto twin =
      nlohmann::json::parse(read_file(kVectors / "released-folder.json", std::size_t{1} << 24));
  ASSERT_EQ(folder.size(), twin.size());
  for (std::size_t k = 0; k < twin.size(); ++k) {
    const ReleasedCell read = folder.read(k);
    const Cell& cell = read.cell;
    validate(cell);
    EXPECT_EQ(cell.sequence, k);
    EXPECT_EQ(cell.first_scan, twin[k]["first_scan"]);
    EXPECT_EQ(cell.scan_count, twin[k]["scan_count"]);
    EXPECT_EQ(read.scans.size(), cell.scan_count);
    EXPECT_EQ(cell.first_stamp, twin[k]["first_stamp_ns"]);
    EXPECT_EQ(read.dropped, twin[k]["dropped"]);
    EXPECT_EQ(cell.indices, twin[k]["indices"].get<std::vector<std::uint32_t>>());
    for (int i = 0; i < 3; ++i) {
      EXPECT_NEAR(cell.T_odom_cell.translation()[i], twin[k]["t_odom_cell"][i], 1e-6);
    }
    const double yaw = twin[k]["yaw_rad"];
    EXPECT_NEAR(cell.T_odom_cell.linear()(1, 0), std::sin(yaw), 2e-6);
    for (std::size_t i = 0; i < cell.planes.size(); ++i) {
      const Plane& plane = cell.planes[i];
      EXPECT_NEAR(plane.distance_m, twin[k]["distances"][i].get<double>(), 1e-6 * 100);
      EXPECT_NEAR(plane.nx, twin[k]["normals"][i][0].get<double>(), 1e-6);
      EXPECT_NEAR(plane.ny, twin[k]["normals"][i][1].get<double>(), 1e-6);
      EXPECT_NEAR(plane.nz, twin[k]["normals"][i][2].get<double>(), 1e-6);
    }
  }
}

TEST(ReleasedFolder, AsManyPosesAsCellsSayWhereEachBegins) {
  const FolderCopy copy;
  copy.write("cell_odom.txt",
             "1 0 0 0 1 0 0 0 1 0 0 0\n0 -1 0 3 1 0 0 0 0 0 1 0\n1 0 0 4 0 1 0 0 0 0 1 0\n");
  const auto refused = copy.error();  // the first is no rotation
  ASSERT_TRUE(refused);
  EXPECT_EQ(refused->code, ErrorCode::kCorruptData);
  copy.write("cell_odom.txt",
             "1 0 0 0 0 1 0 0 0 0 1 0\n0 -1 0 3 1 0 0 0 0 0 1 0\n1 0 0 4 0 1 0 0 0 0 1 0\n");
  const ReleasedFolder folder(copy.path(), small_bands());
  EXPECT_EQ(folder.read(1).cell.first_scan, 1u);
  EXPECT_EQ(folder.read(1).cell.T_odom_cell.translation().x(), 3);
  EXPECT_EQ(folder.read(2).cell.scan_count, 1u);
}

TEST(ReleasedFolder, WhatDoesNotFitIsNamed) {
  struct Case {
    const char* file;
    std::string text;
    ErrorCode code;
    const char* says;
  };
  const std::string head = "FIELDS x y z intensity\nSIZE 4 4 4 4\nTYPE F F F F\n";
  for (const auto& [file, text, code, says] : {
           Case{"cell_7.pcd", "", ErrorCode::kCorruptData, "numbered from 0 on"},
           Case{"cell_odom.txt", "0 0 0 0 0 0 0 1\n1 9 0 0 0 0 0 1\n", ErrorCode::kCorruptData,
                "base_gap"},
           Case{"index_0.txt", "1 2 3", ErrorCode::kCorruptData, "3 lattice points"},
           Case{"index_1.txt", "5 4", ErrorCode::kCorruptData, "number 2"},
           Case{"index_1.txt", "99999999", ErrorCode::kCorruptData, "--lattice-size"},
           Case{"index_1.txt", "-1", ErrorCode::kCorruptData, "number 1"},
           Case{"cell_1.pcd", "nothing of the kind", ErrorCode::kCorruptData, "no header"},
           Case{"cell_1.pcd", "FIELDS x y z\nDATA ascii\n", ErrorCode::kUnsupported, "intensity"},
           Case{"cell_1.pcd", head + "POINTS 4000000000\nDATA ascii\n", ErrorCode::kTooLarge,
                "4000000000 planes"},
           Case{"cell_1.pcd", head + "POINTS 99999999999999999999\nDATA ascii\n",
                ErrorCode::kCorruptData, "POINTS"},
           Case{"cell_1.pcd", head + "POINTS 2\nDATA ascii\n1 0 0 4\n0 1 0 x\n",
                ErrorCode::kCorruptData, "plane 1"},
           Case{"cell_1.pcd", head + "POINTS 800\nDATA binary\n1234", ErrorCode::kCorruptData,
                "800 planes"},
           Case{"cell_1.pcd", head + "POINTS 2\nDATA binary_compressed\n", ErrorCode::kUnsupported,
                "ascii or binary"},
       }) {
    SCOPED_TRACE(says);
    const FolderCopy copy;
    copy.write(file, text);
    const auto error = copy.error();
    ASSERT_TRUE(error);
    EXPECT_EQ(error->code, code) << error->message;
    EXPECT_THAT(error->message, HasSubstr(says));
  }
}

TEST(ReleasedFolder, AMissingFileIsNotFound) {
  for (const char* file : {"index_1.txt", "cell_odom.txt"}) {
    const FolderCopy copy;
    fs::remove(copy.path() / file);
    const auto error = copy.error();
    ASSERT_TRUE(error);
    EXPECT_EQ(error->code, ErrorCode::kNotFound);
    EXPECT_THAT(error->message, HasSubstr(file));
  }
  EXPECT_EQ(thrown_by([] { ReleasedFolder("/nowhere", small_bands()); })->code,
            ErrorCode::kNotFound);
  const test::TempFolder empty;
  EXPECT_EQ(thrown_by([&] { ReleasedFolder(empty.path(), small_bands()); })->code,
            ErrorCode::kNotFound);
}

TEST(ReleasedFolder, HostileFilesAreRefusedOrValid) {
  std::mt19937 rng(7);
  int accepted = 0, refused = 0;
  for (const char* file : {"cell_1.pcd", "cell_2.pcd", "index_1.txt", "cell_odom.txt"}) {
    const FolderCopy copy;
    const std::string good = copy.read(file);
    for (int trial = 0; trial < 300; ++trial) {
      std::string bad = good;
      for (int n = 1 + static_cast<int>(rng() % 4); n > 0; --n) {
        bad[rng() % bad.size()] = static_cast<char>(rng() % 3 ? "0123456789.- e\nnaif"[rng() % 19]
                                                              : static_cast<int>(rng() % 256));
      }
      if (rng() % 4 == 0) bad.resize(rng() % bad.size());
      copy.write(file, bad);
      const auto error = copy.error();
      ++(error ? refused : accepted);
    }
  }
  EXPECT_GT(accepted, 0);
  EXPECT_GT(refused, 0);
}

TEST(ReleasedFolder, OptionsAreChecked) {
  ReleasedFolderOptions options = small_bands();
  options.cell_distance_m = 0;
  EXPECT_EQ(thrown_by([&] { options.validate(); })->code, ErrorCode::kInvalidArgument);
  options = small_bands();
  options.session = "a b";
  EXPECT_EQ(thrown_by([&] { options.validate(); })->code, ErrorCode::kInvalidArgument);
  options = small_bands();
  options.lattice.size = 3;
  EXPECT_EQ(thrown_by([&] { options.validate(); })->code, ErrorCode::kUnsupported);
}

}  // namespace
}  // namespace cellmap
