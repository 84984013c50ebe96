#include "cellmap/change/change_regions.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <set>

namespace cellmap {
namespace {

ChangedPatch patch(double x, double y, double z, std::uint32_t cell = 1) {
  return {CellId{cell}, {x, y, z}, 0.1};
}

/// The slow twin: spreads from patch to patch, comparing all with all.
std::multiset<std::size_t> sizes_by_spreading(const std::vector<ChangedPatch>& patches,
                                              double gap_m) {
  std::multiset<std::size_t> sizes;
  std::vector<bool> taken(patches.size(), false);
  for (std::size_t first = 0; first < patches.size(); ++first) {
    if (taken[first]) continue;
    std::vector<std::size_t> group{first};
    taken[first] = true;
    for (std::size_t k = 0; k < group.size(); ++k) {
      for (std::size_t j = 0; j < patches.size(); ++j) {
        const double apart_m = (patches[group[k]].position - patches[j].position).norm();
        if (taken[j] || apart_m > gap_m) continue;
        taken[j] = true;
        group.push_back(j);
      }
    }
    sizes.insert(group.size());
  }
  return sizes;
}

TEST(ChangeRegions, AreThoseOfTheSlowTwin) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> place(-6, 6);
  std::vector<ChangedPatch> patches;
  for (int i = 0; i < 600; ++i)
    patches.push_back(patch(place(random), place(random), 0.3 * place(random)));
  for (const double gap_m : {0.3, 0.6, 0.9}) {
    std::multiset<std::size_t> sizes;
    for (const auto& region : group_changes(patches, PatchChange::kVanished, gap_m, 1)) {
      sizes.insert(region.patches);
    }
    EXPECT_EQ(sizes, sizes_by_spreading(patches, gap_m)) << gap_m;
  }
}

TEST(ChangeRegions, SayWhereTheyAreAndWhoSawThem) {
  const auto regions = group_changes({patch(1, 0, 0, 2), patch(1.5, 0, 0, 1), patch(2, 0, 0.3, 2)},
                                     PatchChange::kAppeared, 0.7, 1);
  ASSERT_EQ(regions.size(), 1u);
  const ChangeRegion& region = regions[0];
  EXPECT_EQ(region.change, PatchChange::kAppeared);
  EXPECT_TRUE(region.centroid.isApprox(Eigen::Vector3d(1.5, 0, 0.1)));
  EXPECT_TRUE(region.box.sizes().isApprox(Eigen::Vector3d(1, 0, 0.3)));
  EXPECT_THAT(region.cells, testing::ElementsAre(CellId{1}, CellId{2}));
  EXPECT_DOUBLE_EQ(region.area_m2, 0.2);  // of CELL 2, which saw most
}

TEST(ChangeRegions, SmallOnesAreLeftOutAndLargeOnesComeFirst) {
  std::vector<ChangedPatch> patches{patch(0, 0, 0), patch(0.1, 0, 0)};
  for (int i = 0; i < 5; ++i) patches.push_back(patch(9 + 0.1 * i, 0, 0));
  patches.push_back(patch(-9, 0, 0));
  const auto regions = group_changes(patches, PatchChange::kVanished, 0.5, 2);
  ASSERT_EQ(regions.size(), 2u);
  EXPECT_EQ(regions[0].patches, 5u);
  EXPECT_EQ(regions[1].patches, 2u);
}

TEST(ChangeRegions, NothingChangedIsNoRegion) {
  EXPECT_TRUE(group_changes({}, PatchChange::kVanished, 0.5, 1).empty());
}

}  // namespace
}  // namespace cellmap
