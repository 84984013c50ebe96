#include "cellmap/geometry/voxel_grid.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <set>

namespace cellmap {
namespace {

TEST(VoxelCounter, CountsTheVoxelsThatASetOfThemHoldsWhileItGrows) {
  constexpr double kSizeM = 0.4;
  std::mt19937 rng(5);
  std::normal_distribution<float> spread(0, 25);  // both sides of the origin
  VoxelCounter counter(kSizeM);
  std::set<std::array<long, 3>> slow;
  for (int scan = 0; scan < 20; ++scan) {
    PointCloud cloud;
    for (int i = 0; i < 2'000; ++i) {
      const Eigen::Vector3f p(spread(rng), spread(rng), 0.1f * spread(rng));
      cloud.push_back(p);
      cloud.push_back(p);
      slow.insert({std::lround(std::floor(p.x() / kSizeM)), std::lround(std::floor(p.y() / kSizeM)),
                   std::lround(std::floor(p.z() / kSizeM))});
    }
    counter.add(cloud);
    EXPECT_EQ(counter.size(), slow.size());
    counter.add(cloud);
    EXPECT_EQ(counter.size(), slow.size()) << "nothing new";
  }
}

TEST(VoxelCounter, ReachesAMillionVoxelsAwayFromTheOrigin) {
  VoxelCounter counter(1.0);
  PointCloud cloud;
  for (const float far : {-1'048'576.0f, 1'048'575.0f}) {
    cloud.push_back({far, far, far});
    cloud.push_back({far, far, -1 - far});
    cloud.push_back({far, far, far});
  }
  counter.add(cloud);
  EXPECT_EQ(counter.size(), 4U);
}

TEST(VoxelCounter, TakesInWhatOthersHaveCounted) {
  std::mt19937 rng(6);
  std::normal_distribution<float> spread(0, 9);
  VoxelCounter together(0.4), merged(0.4), part(0.4);
  for (int scan = 0; scan < 5; ++scan) {
    PointCloud cloud;
    for (int i = 0; i < 3'000; ++i) cloud.push_back({spread(rng), spread(rng), spread(rng)});
    together.add(cloud);
    part.clear();
    part.add(cloud);
    merged.add(part.blocks());
    EXPECT_EQ(merged.size(), together.size());
  }
  EXPECT_EQ(merged.blocks(), together.blocks());
  EXPECT_LT(together.blocks().back().key, kVoxelKeys);
  merged.clear();
  EXPECT_EQ(merged.size(), 0u);
  EXPECT_TRUE(merged.blocks().empty());
}

}  // namespace
}  // namespace cellmap
