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

/// A CELL and what is around it as they were measured, with the pose known from the simulator.
struct Measured {
  double tight, visible_tight, weakest_share;
  SurroundingsScores around;

  double confidence() const {
    StructureScores scores;
    scores.points = scores.planes = 1'000;
    scores.tight_ratio = tight;
    scores.visible_tight_ratio = visible_tight;
    return confidence_of(scores, around, weakest_share);
  }
};

/// The hardest wrong poses of simulated cities 101 to 103, of KITTI 00 and of a Livox Avia: all but
/// the last convince their own CELL.
TEST(Confidence, WrongPosesThatConvinceTheirOwnCellAreNotBelieved) {
  for (const Measured& wrong :
       {Measured{0.60, 0.76, 0.065, {7, 24, 0.292, 0.851}},    // 260 m off, the same crossing
        Measured{0.528, 0.666, 0.066, {7, 21, 0.436, 0.522}},  // 3.1 m along the street
        Measured{0.55, 0.661, 0.040, {7, 34, 0.496, 0.732}},   // 1.8 m along the street
        Measured{0.486, 0.555, 0.120, {7, 19, 0.405, 0.455}},  // KITTI 00, 152 m off
        Measured{0.519, 0.60, 0.070, {7, 9, 0.553, 0.796}},    // Livox Avia, 2.6 m off
        Measured{0.425, 0.558, 0.178, {7, 22, 0.535, 0.570}}}) {
    EXPECT_LT(wrong.confidence(), 0.9) << wrong.tight;
  }
}

TEST(Confidence, RightPosesThatSeeLittleAreBelieved) {
  for (const Measured& right : {Measured{0.458, 0.575, 0.069, {7, 23, 0.698, 0.346}},  // occluded
                                Measured{0.478, 0.60, 0.133, {7, 35, 0.653, 0.621}},   // other lane
                                Measured{0.487, 0.60, 0.183, {7, 22, 0.489, 0.953}}}) {  // KITTI 00
    EXPECT_GT(right.confidence(), 0.9) << right.tight;
  }
}

TEST(Confidence, TooFewCellsAroundAreNoSecondOpinion) {
  const Measured alone{0.6, 0.7, 0.06, {2, 30, 0.2, 0.2}};
  StructureScores scores;
  scores.points = scores.planes = 1'000;
  scores.tight_ratio = 0.6;
  scores.visible_tight_ratio = 0.7;
  EXPECT_EQ(alone.confidence(), confidence_of(scores, 0.06));
}

}  // namespace
}  // namespace cellmap
