#include "cellmap/evaluation/representation.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/evaluation/nearest_points.hpp"
#include "cellmap/evaluation/point_bytes.hpp"
#include "cellmap/evaluation/surface_index.hpp"
#include "support/expect_error.hpp"
#include "support/street_drive.hpp"

namespace cellmap {
namespace {

using test::expect_error;
using test::street_drive;

std::size_t total_bytes(const MapFiles& files) {
  std::size_t bytes = 0;
  for (const MapFile& file : files) bytes += file.bytes.size();
  return bytes;
}

void expect_equal(const PointCloud& a, const PointCloud& b) {
  EXPECT_EQ(a.x, b.x);
  EXPECT_EQ(a.y, b.y);
  EXPECT_EQ(a.z, b.z);
}

TEST(ComparedDrive, HoldsBackScansEvenlyAndNeverTheFirst) {
  for (const std::size_t held_back : {1u, 3u, 5u}) {
    const ComparedDrive drive = street_drive(11, held_back);
    EXPECT_EQ(drive.held_back.size(), held_back);
    EXPECT_EQ(drive.mapped.size(), 11 - held_back);
    EXPECT_EQ(drive.mapped.front().T_map_scan.translation().norm(), 0);
  }
}

TEST(ComparedDrive, IsAsLongAsThePathOverAllScans) {
  // Ten steps of 2 m along and 0, 0.1, 0.1 or 0.2 m across.
  const ComparedDrive drive = street_drive(11, 2);
  EXPECT_NEAR(drive.length_m, 20, 0.05);
  EXPECT_GT(drive.length_m, 20);
}

TEST(ComparedDrive, RefusesADriveOfWhichNothingWouldBeLeft) {
  expect_error(
      ErrorCode::kInvalidArgument, [&] { street_drive(3, 2); }, "at least 4 scans");
}

TEST(VoxelMeans, AreTheMeansOfThePointsWithin) {
  PointCloud points;
  points.push_back({0.1F, 0.1F, 0.1F});
  points.push_back({-0.1F, 0.1F, 0.1F});
  points.push_back({0.3F, 0.3F, 0.1F});
  const PointCloud means = voxel_means(points, 0.4);
  ASSERT_EQ(means.size(), 2u);
  EXPECT_TRUE(means[0].isApprox(Eigen::Vector3f(0.2F, 0.2F, 0.1F)));
  EXPECT_TRUE(means[1].isApprox(Eigen::Vector3f(-0.1F, 0.1F, 0.1F)));
}

TEST(RawPoints, ComeBackToTheBit) {
  const ComparedDrive drive = street_drive(4, 1);
  for (const Representation& raw : {raw_points(), raw_points(3)}) {
    expect_equal(raw.decode(raw.encode(drive)).points, stacked_points(drive));
  }
}

TEST(RawPoints, CompressedAreTheSameFileAsAZstdFrame) {
  const ComparedDrive drive = street_drive(3, 1);
  EXPECT_EQ(zstd_decompress(raw_points(3).encode(drive).at(0).bytes, std::size_t{1} << 30),
            raw_points().encode(drive).at(0).bytes);
}

TEST(VoxelPoints, ComeBackToTheBit) {
  const ComparedDrive drive = street_drive(3, 1);
  const Representation voxels = voxel_points(0.4);
  expect_equal(voxels.decode(voxels.encode(drive)).points, voxel_means(stacked_points(drive), 0.4));
}

TEST(QuantisedVoxels, MoveEachMeanByHalfAStepAtMost) {
  const ComparedDrive drive = street_drive(3, 1);
  const PointCloud means = voxel_means(stacked_points(drive), 0.4);
  const Representation grid = quantised_voxels(0.4, 0.05);
  const PointCloud found = grid.decode(grid.encode(drive)).points;
  ASSERT_EQ(found.size(), means.size());
  const NearestPoints tree(found);
  for (std::size_t i = 0; i < means.size(); ++i) {
    const Eigen::Vector3f off = found[tree.nearest(means[i]).index] - means[i];
    EXPECT_LE(off.cwiseAbs().maxCoeff(), 0.025F + 1e-4F);
  }
}

TEST(QuantisedVoxels, AreSmallerThanTheirFloats) {
  const ComparedDrive drive = street_drive(3, 1);
  EXPECT_LT(3 * total_bytes(quantised_voxels(0.4, 0.01).encode(drive)),
            total_bytes(voxel_points(0.4).encode(drive)));
}

TEST(QuantisedVoxels, AskForAStepThatDividesTheVoxel) {
  expect_error(
      ErrorCode::kInvalidArgument, [&] { quantised_voxels(0.4, 0.03); }, "divides");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { quantised_voxels(0.4, 0.001); }, "divides");
}

TEST(QuantisedVoxels, RefuseBytesThatWereCutOff) {
  const Representation grid = quantised_voxels(0.4, 0.05);
  MapFiles files = grid.encode(street_drive(3, 1));
  Bytes plain = zstd_decompress(files[0].bytes, 1 << 26);
  plain.pop_back();
  files[0].bytes = zstd_compress(plain);
  expect_error(
      ErrorCode::kCorruptData, [&] { grid.decode(files); }, "three steps");
}

TEST(Surfels, LieOnTheGroundWithItsNormal) {
  const ComparedDrive drive = street_drive(4, 1);
  const Representation row = surfels(0.4);
  const MapFiles files = row.encode(drive);
  const DecodedMap map = row.decode(files);
  EXPECT_EQ(total_bytes(files), 28 * map.points.size());
  std::size_t ground = 0, level = 0;
  for (std::size_t i = 0; i < map.points.size(); ++i) {
    // The ground of the street, without what stands on it and the edges beside it.
    if (std::abs(map.points.y[i]) > 3 || std::abs(map.points.z[i] + 1.7F) > 0.1F) continue;
    ++ground;
    level += std::abs(map.normals.z[i]) > 0.98F;
  }
  EXPECT_GT(ground, 100u);
  EXPECT_GT(level, 0.8 * ground);  // the points of some voxels lie nearly along one ring
}

TEST(Cells, OfEveryFormHaveTheSamePlanesAndPoses) {
  const ComparedDrive drive = street_drive(10, 1);
  const auto read = [&](const CellForm& form) {
    const Representation row = cells(form, 6, {}, {LatticeKind::kFibonacci, 20'000});
    return row.decode(row.encode(drive));
  };
  const DecodedMap raw = read({});
  const DecodedMap packed = read(CellForm{KeptEncoding::kPacked});
  const DecodedMap compact = read(compact_form(0.02));
  ASSERT_EQ(raw.cells.size(), 3u);
  for (std::size_t k = 0; k < raw.cells.size(); ++k) {
    EXPECT_EQ(raw.cells[k].target->cell().planes, packed.cells[k].target->cell().planes);
    EXPECT_EQ(raw.cells[k].target->cell().indices, compact.cells[k].target->cell().indices);
    EXPECT_TRUE(raw.cells[k].T_map_cell.isApprox(compact.cells[k].T_map_cell));
  }
  EXPECT_GT(raw.surface.triangles.size(), 1000u);
}

TEST(Cells, AreNamedByTheirForm) {
  std::set<std::string> names;
  for (const CellForm& form :
       {CellForm{}, CellForm{KeptEncoding::kPacked}, compact_form(0.005), compact_form(0.02)}) {
    names.insert(cells(form, 6, {}, {}).name);
  }
  EXPECT_EQ(names.size(), 4u);
  EXPECT_TRUE(names.contains("CELLs, compact, 20 mm"));
}

TEST(PlyBytes, HoldTheMesh) {
  TriangleMesh mesh;
  mesh.add_polygon(std::vector<Eigen::Vector3d>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0.5}, {0, 1, 0.5}});
  const TriangleMesh read = mesh_of_ply(ply_bytes(mesh));
  expect_equal(read.vertices, mesh.vertices);
  EXPECT_EQ(read.triangles, mesh.triangles);
}

TEST(PlyBytes, ThatWereCutOffOrPointOutsideAreRefused) {
  TriangleMesh mesh;
  mesh.add_polygon(std::vector<Eigen::Vector3d>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0.5}});
  Bytes bytes = ply_bytes(mesh);
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    expect_error(
        ErrorCode::kCorruptData, [&] { mesh_of_ply(std::span(bytes).first(length)); }, "PLY");
  }
  mesh.triangles[0][2] = 3;
  expect_error(
      ErrorCode::kCorruptData, [&] { mesh_of_ply(ply_bytes(mesh)); }, "between vertices");
}

}  // namespace
}  // namespace cellmap
