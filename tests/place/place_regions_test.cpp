#include "cellmap/place/place_regions.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <random>

#include "cellmap/place/polar_image.hpp"

namespace cellmap {
namespace {

PoseGraph scattered_graph(std::uint32_t cells, double side_m) {
  std::mt19937 rng(5);
  std::uniform_real_distribution<double> xy(-side_m / 2, side_m / 2);
  PoseGraph graph;
  for (std::uint32_t i = 1; i <= cells; ++i) graph.nodes[{i}] = upright_pose(xy(rng), xy(rng), 0);
  return graph;
}

std::vector<CellId> ids_of(const PlaceRegions& regions) {
  std::vector<CellId> ids;
  for (const auto& region : regions.all()) {
    EXPECT_TRUE(std::ranges::is_sorted(region.ids));
    EXPECT_EQ(region.ids.size(), region.positions.size());
    ids.insert(ids.end(), region.ids.begin(), region.ids.end());
  }
  EXPECT_EQ(ids.size(), regions.cells());
  std::ranges::sort(ids);
  return ids;
}

TEST(PlaceRegions, ACellLiesInTheSquareOfItsPosition) {
  PoseGraph graph;
  graph.nodes[{1}] = upright_pose(0, 0, 0);
  graph.nodes[{2}] = upright_pose(kRegionSideM - 0.01, 10, 1);
  graph.nodes[{3}] = upright_pose(kRegionSideM, 10, 1);
  graph.nodes[{4}] = upright_pose(-0.01, -2 * kRegionSideM, 0);
  const PlaceRegions regions(graph);
  ASSERT_EQ(regions.all().size(), 3u);
  EXPECT_EQ(regions.find({0, 0})->ids, (std::vector<CellId>{{1}, {2}}));
  EXPECT_EQ(regions.find({1, 0})->ids, (std::vector<CellId>{{3}}));
  EXPECT_EQ(regions.find({-1, -2})->ids, (std::vector<CellId>{{4}}));
  EXPECT_EQ(regions.find({-1, -1}), nullptr);
}

TEST(PlaceRegions, EveryCellLiesInOneRegion) {
  const PoseGraph graph = scattered_graph(3000, 5000);
  std::vector<CellId> all;
  for (const auto& [id, pose] : graph.nodes) all.push_back(id);
  EXPECT_EQ(ids_of(PlaceRegions(graph)), all);
  const PlaceRegions even(graph, [](CellId id) { return id.value % 2 == 0; });
  std::erase_if(all, [](CellId id) { return id.value % 2 == 1; });
  EXPECT_EQ(ids_of(even), all);
}

TEST(PlaceRegions, WhatIsWithinReachIsWhatADistanceToEachSays) {
  const PoseGraph graph = scattered_graph(3000, 3000);
  const PlaceRegions regions(graph);
  for (const auto& [x, y, radius_m] :
       {std::array{0.0, 0.0, 30.0}, std::array{250.0, -260.0, 300.0},
        std::array{-900.0, 40.0, 5000.0}, std::array{9000.0, 0.0, 100.0}}) {
    std::vector<CellId> expected;
    for (const auto& [id, pose] : graph.nodes) {
      const double metres = (pose.translation().head<2>() - Eigen::Vector2d(x, y)).norm();
      if (metres <= radius_m) expected.push_back(id);
    }
    EXPECT_EQ(ids_of(regions.within({x, y}, radius_m)), expected) << x << ' ' << radius_m;
  }
}

TEST(PlaceRegions, PositionsThatNoMapHasAreBearable) {
  PoseGraph graph;
  graph.nodes[{1}] = upright_pose(1e300, -1e300, 0);
  const PlaceRegions regions(graph);
  EXPECT_EQ(regions.cells(), 1u);
  EXPECT_EQ(regions.within({0, 0}, 1e6).cells(), 0u);
}

}  // namespace
}  // namespace cellmap
