#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>

#include "cellmap/evaluation/nearest_points.hpp"
#include "cellmap/evaluation/point_bytes.hpp"
#include "cellmap/export/point_file.hpp"
#include "cellmap/export/tiles.hpp"
#include "cellmap/pcl/pcl_representations.hpp"
#include "cellmap/pcl/scan_file.hpp"
#include "support/street_drive.hpp"
#include "support/temp_folder.hpp"

// What we write without PCL, read by PCL; and what PCL and Draco make of a drive.

namespace cellmap {
namespace {

PointCloud street_points() { return voxel_means(stacked_points(test::street_drive(3, 1)), 0.4); }

void expect_equal(const PointCloud& a, const PointCloud& b) {
  EXPECT_EQ(a.x, b.x);
  EXPECT_EQ(a.y, b.y);
  EXPECT_EQ(a.z, b.z);
}

double farthest(const PointCloud& from, const PointCloud& to) {
  const NearestPoints tree(to);
  float farthest = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    farthest = std::max(farthest, tree.nearest(from[i]).squared_distance_m2);
  }
  return std::sqrt(farthest);
}

TEST(ExportedPoints, AreReadByPcl) {
  const test::TempFolder folder;
  const PointCloud points = street_points();
  for (const char* name : {"town.ply", "town.pcd"}) {
    const auto file = folder.path() / name;
    PointFileWriter writer(file, point_format_of(file));
    writer.add(points, points);
    writer.finish();
    expect_equal(pcl_io::read_scan_file(file), points);
  }
}

TEST(ExportedTiles, AreReadByPcl) {
  const test::TempFolder folder;
  PointCloud points;
  for (int i = 0; i < 1'000; ++i) points.push_back({0.01F * static_cast<float>(i), 5, 1});
  TileWriter writer(folder.path() / "tiles", 20);
  writer.add(points, points);
  writer.finish();
  expect_equal(pcl_io::read_scan_file(folder.path() / "tiles" / "0_0.pcd"), points);
}

TEST(ComparedPcd, IsReadByPcl) {
  const test::TempFolder folder;
  const PointCloud points = street_points();
  const Bytes bytes = pcd_bytes(points);
  const auto file = folder.path() / "points.pcd";
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  expect_equal(pcl_io::read_scan_file(file), points);
}

TEST(DracoRow, KeepsEveryPointWithinAStep) {
  const ComparedDrive drive = test::street_drive(3, 1);
  const PointCloud means = street_points();
  for (const double step_m : {0.01, 0.05}) {
    const Representation row = pcl_io::draco_compressed(0.4, step_m);
    const MapFiles files = row.encode(drive);
    const PointCloud found = row.decode(files).points;
    EXPECT_EQ(found.size(), means.size());
    EXPECT_LT(farthest(means, found), step_m * 0.87 + 1e-4);  // half a step on each axis
    EXPECT_LT(files[0].bytes.size(), 6 * means.size());
  }
}

TEST(OctreeRow, KeepsEveryPointWithinAStep) {
  const ComparedDrive drive = test::street_drive(3, 1);
  const PointCloud means = street_points();
  const Representation row = pcl_io::octree_compressed(0.4, 0.01);
  const MapFiles files = row.encode(drive);
  const PointCloud found = row.decode(files).points;
  EXPECT_EQ(found.size(), means.size());
  EXPECT_LT(farthest(means, found), 0.01 * 1.74);  // a step on each axis: PCL rounds down
  EXPECT_LT(files[0].bytes.size(), 6 * means.size());
}

TEST(MeshRow, LiesWhereTheStreetIs) {
  const ComparedDrive drive = test::street_drive(4, 1);
  const Representation row = pcl_io::poisson_mesh();
  const DecodedMap map = row.decode(row.encode(drive));
  ASSERT_GT(map.surface.triangles.size(), 500u);
  EXPECT_EQ(map.points.size(), map.normals.size());
  // No corner is farther than 0.3 m from a point, which are means of 0.2 m voxels.
  EXPECT_LT(farthest(map.surface.vertices, voxel_means(stacked_points(drive), 0.2)), 0.301);
}

}  // namespace
}  // namespace cellmap
