#include "cellmap/cell/cell_builder.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "cellmap/cell/range_gap.hpp"
#include "support/box_scene.hpp"
#include "support/instruction_sets.hpp"

namespace cellmap {
namespace {

using test::BoxScene;
using test::level_pose;

constexpr PlaneFit kFits[] = {PlaneFit::kTrimmed, PlaneFit::kRansac, PlaneFit::kStreaming};

Scan street_scan(int k) {
  const BoxScene::Sensor sensor{.noise_m = 0.02};
  return Scan{.stamp = 10 * k, .points = test::street().scan(level_pose(1.5 * k, 0, k), sensor)};
}

LocalMap street_map(int scans) {
  LocalMap map(street_scan(0), level_pose(0, 0, 0), 5);
  for (int k = 1; k < scans; ++k) map.add(street_scan(k), level_pose(1.5 * k, 0, k));
  return map;
}

void expect_same(const Cell& a, const Cell& b, const std::string& what) {
  EXPECT_EQ(a.indices, b.indices) << what;
  EXPECT_EQ(a.planes, b.planes) << what;
  EXPECT_EQ(a.statistics, b.statistics) << what;
}

TEST(CellBuilder, GivesTheSameBytesWhetherScansComeOneByOneOrAtOnce) {
  const Lattice lattice(LatticeSpec{});
  for (const PlaneFit fit : kFits) {
    CellBuilder builder(lattice, {.fit = fit});
    LocalMap map = street_map(1);
    builder.update(map);
    for (int k = 1; k < 3; ++k) {
      map.add(street_scan(k), level_pose(1.5 * k, 0, k));
      builder.update(map);
      builder.update(map);
    }
    const Cell streamed = builder.finish(map);
    ASSERT_GT(streamed.planes.size(), 3'000U);
    expect_same(streamed, build_cell(map, lattice, {.fit = fit}), to_string(fit));
    expect_same(streamed, builder.finish(map), "finished twice");
    EXPECT_EQ(streamed.scan_count, 3U);
    EXPECT_EQ(streamed.last_stamp, 20);
  }
}

TEST(CellBuilder, TheBytesDependNeitherOnThreadsNorOnTheInstructionSet) {
  const Lattice lattice(LatticeSpec{});
  const LocalMap map = street_map(2);
  for (const PlaneFit fit : kFits) {
    const Cell expected = build_cell(map, lattice, {.fit = fit});
    test::for_each_instruction_set([&](const std::string& name) {
      for (const int threads : {1, 4}) {
        expect_same(build_cell(map, lattice, {.fit = fit, .threads = threads}), expected,
                    to_string(fit) + ' ' + name + ' ' + std::to_string(threads));
      }
    });
  }
}

TEST(CellBuilder, StreamedTheSamePatchesHaveTooFewPointsOrAGap) {
  const Lattice lattice(LatticeSpec{});
  const LocalMap map = street_map(3);
  for (const double gap_m : {3.0, 1.0, 0.2}) {
    const CellStatistics a = build_cell(map, lattice, {.max_range_gap_m = gap_m}).statistics;
    const CellStatistics b =
        build_cell(map, lattice, {.max_range_gap_m = gap_m, .fit = PlaneFit::kStreaming})
            .statistics;
    EXPECT_EQ(a.points, b.points);
    EXPECT_EQ(a.patches_hit, b.patches_hit);
    EXPECT_EQ(a.rejected_few_points, b.rejected_few_points);
    EXPECT_EQ(a.rejected_gap, b.rejected_gap);
    EXPECT_GT(a.rejected_gap, 50U);
  }
}

TEST(CellBuilder, RefusesOptionsOutOfTheirRanges) {
  const Lattice lattice(LatticeSpec{});
  EXPECT_ANY_THROW(CellBuilder(lattice, {.min_points = 2}));
}

TEST(PlaneFitNames, GoThereAndBack) {
  for (const PlaneFit fit : kFits) EXPECT_EQ(plane_fit_from(to_string(fit)), fit);
  EXPECT_EQ(plane_fit_from("pca"), std::nullopt);
  EXPECT_EQ(plane_fit_from(""), std::nullopt);
}

/// The definition, after sorting.
bool has_gap_by_sorting(std::vector<double> ranges, double max_gap_m) {
  std::sort(ranges.begin(), ranges.end());
  for (std::size_t i = 1; i < ranges.size(); ++i) {
    if (ranges[i] - ranges[i - 1] > max_gap_m) return true;
  }
  return false;
}

TEST(RangeGap, BinsAndClustersDecideAsSortingDoesInAnyOrder) {
  constexpr double kGapM = 3.0;
  std::mt19937 rng(3);
  std::size_t with_gap = 0;
  for (int trial = 0; trial < 20'000; ++trial) {
    const double step = 0.1 * (1 + trial % 37);
    std::uniform_real_distribution<double> jump(0, 2 * step);
    std::vector<double> ranges = {5 + jump(rng)};
    const std::size_t count = 1 + trial % 60;
    while (ranges.size() < count) ranges.push_back(ranges.back() + jump(rng));
    if (trial % 5 == 0) ranges.push_back(ranges.back() + kGapM);         // not more than the gap
    if (trial % 7 == 0) ranges.push_back(ranges.back() + kGapM + 1e-9);  // just more
    std::shuffle(ranges.begin(), ranges.end(), rng);

    const bool expected = has_gap_by_sorting(ranges, kGapM);
    with_gap += expected;
    RangeClusters clusters;
    for (const double range : ranges) clusters.add(range, range, kGapM);
    const auto [least, most] = std::minmax_element(ranges.begin(), ranges.end());
    ASSERT_EQ(clusters.has_gap(), expected) << trial;
    ASSERT_EQ(clusters.least_m(), *least);
    ASSERT_EQ(clusters.most_m(), *most);
    ASSERT_EQ(has_range_gap(ranges, *least, *most, kGapM), expected) << trial;
  }
  EXPECT_GT(with_gap, 2'000U);
  EXPECT_LT(with_gap, 18'000U);
}

TEST(RangeClusters, AreJoinedByWhatComesBetweenThem) {
  RangeClusters clusters;
  clusters.add(20, 21, 3);
  clusters.add(30, 31, 3);
  EXPECT_TRUE(clusters.has_gap());
  clusters.add(26.5, 28, 3);
  EXPECT_TRUE(clusters.has_gap());
  clusters.add(23.5, 24, 3);
  EXPECT_FALSE(clusters.has_gap());
}

}  // namespace
}  // namespace cellmap
