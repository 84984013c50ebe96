#include "cellmap/place/structure_score.hpp"

#include <gtest/gtest.h>

#include "support/registration_world.hpp"

namespace cellmap {
namespace {

using test::street;
using test::target_at;

const Pose kAtTheCell = Pose::Identity();

/// The street with a wall across it, near enough to hide what is behind.
test::BoxScene walled_street() {
  test::BoxScene scene = street();
  scene.add({6.0, -3.0, -1.7}, {6.5, 4.5, 3.0});
  return scene;
}

TEST(StructureScore, AtTheRightPlaceBothSightLinesAreFree) {
  const StructureScores scores =
      score_structure(target_at(street(), kAtTheCell), street().scan(kAtTheCell), kAtTheCell);
  EXPECT_GT(scores.inlier_ratio, 0.9);
  EXPECT_GT(scores.confirmed_ratio, 0.9);
  EXPECT_LT(scores.share_in_front, 0.02);
  EXPECT_LT(scores.share_seen_through, 0.02);
}

TEST(StructureScore, AScanThatSeesThroughAWallOfTheMapSaysSo) {
  const StructureScores scores = score_structure(target_at(walled_street(), kAtTheCell),
                                                 street().scan(kAtTheCell), kAtTheCell);
  EXPECT_GT(scores.share_seen_through, 0.1);
}

TEST(StructureScore, AWallInTheFreeSpaceOfTheMapIsInFront) {
  const StructureScores scores = score_structure(target_at(street(), kAtTheCell),
                                                 walled_street().scan(kAtTheCell), kAtTheCell);
  EXPECT_GT(scores.share_in_front, 0.1);
}

TEST(StructureScore, PointsAtTheOriginAreNoEvidence) {
  const RegistrationTarget target = target_at(street(), kAtTheCell);
  PointCloud scan = street().scan(kAtTheCell);
  const StructureScores before = score_structure(target, scan, kAtTheCell);
  for (int i = 0; i < 100; ++i) scan.push_back(Eigen::Vector3f::Zero());
  const StructureScores after = score_structure(target, scan, kAtTheCell);
  EXPECT_EQ(after.points, before.points);
  EXPECT_EQ(after.planes, before.planes);
  EXPECT_EQ(after.confirmed_ratio, before.confirmed_ratio);
}

}  // namespace
}  // namespace cellmap
