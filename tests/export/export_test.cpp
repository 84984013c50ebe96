#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/patch_outline.hpp"
#include "cellmap/export/disc_file.hpp"
#include "cellmap/export/occupancy_grid.hpp"
#include "cellmap/export/patch_points.hpp"
#include "cellmap/export/point_file.hpp"
#include "cellmap/export/tiles.hpp"
#include "support/box_scene.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::expect_error;

/// What a program that knows nothing of CELLmap reads of a file.
json read_by(const std::string& program, const std::string& arguments) {
  const std::string command =
      "/usr/bin/python3 " CELLMAP_SOURCE_DIR "/tests/export/" + program + " " + arguments;
  std::FILE* pipe = ::popen(command.c_str(), "r");
  std::string text;
  std::array<char, 4096> buffer;
  while (const std::size_t read = std::fread(buffer.data(), 1, buffer.size(), pipe)) {
    text.append(buffer.data(), read);
  }
  EXPECT_EQ(::pclose(pipe), 0) << text;
  return json::parse(text, nullptr, false);
}

/// A street seen from one place.
class ExportTest : public ::testing::Test {
 protected:
  ExportTest() {
    test::BoxScene::Sensor sensor;
    sensor.beams = 48;
    const LocalMap local_map(filter_scan(test::street().scan(Pose::Identity(), sensor), 0, {}),
                             Pose::Identity(), 0);
    CellBuildOptions strict;
    strict.max_range_gap_m = 0.5;
    cell_ = build_cell(local_map, lattice_, strict);
    cell_.session = "drive";
    T_map_cell_ = test::level_pose(100, -50, 30);
  }

  const Lattice lattice_{{LatticeKind::kFibonacci, 10'000}};
  Cell cell_;
  Pose T_map_cell_;
  test::TempFolder folder_;
};

TEST_F(ExportTest, PatchPointsOfNoDensityAreThePlanesPoints) {
  const PointsOnPatches patches = patch_points(cell_, lattice_, T_map_cell_, 0);
  const PointCloud expected = transformed(reconstruct_points(cell_, lattice_), T_map_cell_);
  ASSERT_EQ(patches.points.size(), cell_.planes.size());
  ASSERT_GT(patches.points.size(), 500u);
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_LT((patches.points[i] - expected[i]).norm(), 1e-4F);
    EXPECT_NEAR(patches.normals[i].norm(), 1, 1e-4F);
  }
}

TEST_F(ExportTest, PatchPointsHaveTheDensityThatWasAskedFor) {
  Cell one = cell_;
  // A patch seen head-on from 20 m: 4 pi 20^2 / 10,000 square metres.
  one.indices = {5'000};
  const Eigen::Vector3f normal = -lattice_.direction(5'000).cast<float>();
  one.planes = {{20, normal.x(), normal.y(), normal.z()}};
  const double area = 4 * std::numbers::pi * 400 / 10'000;
  const PointsOnPatches patches = patch_points(one, lattice_, Pose::Identity(), 0.01);
  EXPECT_NEAR(static_cast<double>(patches.points.size()), area / 1e-4, 0.02 * area / 1e-4);
}

TEST_F(ExportTest, LasIsReadBackToAMillimetreByTheSpecification) {
  const PointsOnPatches patches = patch_points(cell_, lattice_, T_map_cell_, 0.5);
  const fs::path file = folder_.path() / "town.las";
  PointFileWriter writer(file, point_format_of(file));
  writer.add(patches.points, patches.normals);
  writer.finish();
  const json read = read_by("las_check.py", file.string());
  ASSERT_EQ(read.size(), patches.points.size());
  for (std::size_t i = 0; i < patches.points.size(); ++i) {
    const Eigen::Vector3d p(read[i][0], read[i][1], read[i][2]);
    EXPECT_LT((p - patches.points[i].cast<double>()).cwiseAbs().maxCoeff(), 0.00051);
  }
}

TEST_F(ExportTest, LasRefusesWhatItCannotReach) {
  PointCloud far;
  far.push_back({3e6F, 0, 0});
  PointFileWriter writer(folder_.path() / "far.las", PointFormat::kLas);
  expect_error(
      ErrorCode::kTooLarge, [&] { writer.add(far, far); }, "2,147 km");
}

TEST_F(ExportTest, AFileThatWasNotFinishedLeavesNothing) {
  for (const char* name : {"a.ply", "a.pcd", "a.las"}) {
    const fs::path file = folder_.path() / name;
    {
      PointFileWriter writer(file, point_format_of(file));
      writer.add(patch_points(cell_, lattice_, T_map_cell_, 0).points,
                 patch_points(cell_, lattice_, T_map_cell_, 0).normals);
    }
    EXPECT_FALSE(fs::exists(file));
    EXPECT_FALSE(fs::exists(file.string() + ".part"));
  }
}

TEST_F(ExportTest, APointFileIsNamedForItsFormat) {
  expect_error(
      ErrorCode::kInvalidArgument, [] { point_format_of("town.xyz"); }, ".las");
}

TEST_F(ExportTest, PartsMakeTheSameFileAsTheWhole) {
  const PointsOnPatches patches = patch_points(cell_, lattice_, T_map_cell_, 0);
  const auto bytes_of = [&](const std::string& name, std::size_t parts) {
    const fs::path file = folder_.path() / (std::to_string(parts) + name);
    PointFileWriter writer(file, point_format_of(file));
    for (std::size_t part = 0; part < parts; ++part) {
      PointsOnPatches some;
      const std::size_t n = patches.points.size();
      for (std::size_t i = n * part / parts; i < n * (part + 1) / parts; ++i) {
        some.points.push_back(patches.points[i]);
        some.normals.push_back(patches.normals[i]);
      }
      writer.add(some.points, some.normals);
    }
    writer.finish();
    std::ifstream in(file, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  };
  for (const char* name : {".ply", ".pcd", ".las"}) EXPECT_EQ(bytes_of(name, 1), bytes_of(name, 7));
}

TEST_F(ExportTest, DiscsAreFacesOnTheirPlanes) {
  const fs::path file = folder_.path() / "discs.ply";
  DiscFileWriter writer(file);
  writer.add(cell_, lattice_, T_map_cell_);
  writer.finish();
  const json faces = read_by("map_files_check.py", "discs " + file.string())["faces"];
  ASSERT_EQ(faces.size(), cell_.planes.size());
  const PointsOnPatches centres = patch_points(cell_, lattice_, T_map_cell_, 0);
  for (std::size_t k = 0; k < faces.size(); ++k) {
    ASSERT_EQ(faces[k].size(), kOutlineCorners);
    for (const json& vertex : faces[k]) {
      const Eigen::Vector3f p(vertex[0], vertex[1], vertex[2]);
      const Eigen::Vector3f normal(vertex[3], vertex[4], vertex[5]);
      EXPECT_LT((normal - centres.normals[k]).norm(), 1e-5F);
      EXPECT_NEAR(normal.dot(p - centres.points[k]), 0, 2e-3F);
    }
  }
}

TEST_F(ExportTest, TilesHoldEveryPointOnceWhereTheMetadataSays) {
  const PointsOnPatches patches = patch_points(cell_, lattice_, T_map_cell_, 0);
  const fs::path folder = folder_.path() / "tiles";
  TileWriter writer(folder, 20);
  writer.add(patches.points, patches.normals);
  writer.add(patches.points, patches.normals);
  writer.finish();
  const json read = read_by("map_files_check.py", "tiles " + folder.string());
  EXPECT_EQ(read["x_resolution"], 20.0);
  EXPECT_EQ(read["points"], 2 * patches.points.size());
  EXPECT_EQ(read["tiles"], writer.tiles());
  EXPECT_GT(writer.tiles(), 4u);
  expect_error(
      ErrorCode::kAlreadyExists, [&] { TileWriter(folder, 20); }, "another folder");
}

TEST_F(ExportTest, TilesGoToTheirFilesWhenManyPointsWait) {
  PointCloud points;
  for (std::size_t i = 0; i < TileWriter::kWaitingPoints / 2 + 1; ++i) {
    points.push_back({static_cast<float>(i % 40) + 0.5F, -3, 0});
  }
  const fs::path folder = folder_.path() / "tiles";
  TileWriter writer(folder, 20);
  writer.add(points, points);
  EXPECT_FALSE(fs::exists(folder / "0_-20.pcd"));
  writer.add(points, points);  // now they are too many to wait
  EXPECT_TRUE(fs::exists(folder / "0_-20.pcd"));
  writer.add(points, points);
  writer.finish();
  EXPECT_EQ(fs::file_size(folder / "0_-20.pcd") + fs::file_size(folder / "20_-20.pcd"),
            2 * pcd_header(0).size() + 24 * 3 * points.size());
}

TEST_F(ExportTest, TilesAreWholeMetres) {
  expect_error(
      ErrorCode::kInvalidArgument, [&] { TileWriter(folder_.path() / "t", 12.5); }, "whole");
}

TEST_F(ExportTest, OccupancyDrawsTheWallsOfTheStreetAndItsFreeGround) {
  OccupancyOptions options;
  options.resolution_m = 0.2;
  options.max_range_m = 20;
  OccupancyGrid grid(options);
  grid.add(cell_, lattice_, T_map_cell_);
  const fs::path file = folder_.path() / "town.yaml";
  grid.write(file);
  const json read = read_by("map_files_check.py", "occupancy " + file.string());
  EXPECT_EQ(read["width"], grid.width());
  EXPECT_GT(read["free"], 200);
  EXPECT_GT(read["unknown"], 200);
  ASSERT_GT(read["occupied_at"].size(), 50u);
  for (const json& at : read["occupied_at"]) {
    const Eigen::Vector3d p = T_map_cell_.inverse() * Eigen::Vector3d(at[0], at[1], 0);
    // Nothing of the street stands nearer to its middle than 3.7 m.
    EXPECT_GT(std::abs(p.y()), 3.0) << p.transpose();
  }
}

TEST_F(ExportTest, OccupancyIsNotWrittenWithoutAPixelOrUnderAnotherName) {
  const OccupancyGrid empty{OccupancyOptions{}};
  expect_error(ErrorCode::kInvalidArgument, [&] { empty.write(folder_.path() / "a.yaml"); });
  expect_error(
      ErrorCode::kInvalidArgument, [&] { empty.write(folder_.path() / "a.pgm"); }, ".yaml");
  OccupancyOptions options;
  options.resolution_m = 0;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { OccupancyGrid{options}; }, "resolution_m");
}

}  // namespace
}  // namespace cellmap
