#include "cellmap/place/along_street.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "cellmap/place/pose_search.hpp"
#include "cellmap/place/structure_score.hpp"
#include "support/registration_world.hpp"

namespace cellmap {
namespace {

using test::street;
using test::target_at;

Pose along_x(double metres) { return Pose(Eigen::Translation3d(metres, 0, 0)); }

/// A street that holds the motion along it least.
Matrix6d information_of_a_street() {
  Matrix6d information = Matrix6d::Identity();
  information(0, 0) = 0.05;
  return information;
}

std::vector<Pose> starts_when_off_by(double metres, const std::vector<CellAround>& cells) {
  const PointCloud few = thinned(street().scan(Pose::Identity()), 600);
  return starts_along_street(cells, few, along_x(metres), information_of_a_street());
}

std::vector<CellAround> cells_of_the_street() {
  std::vector<CellAround> cells;
  for (const double x : {0.0, 6.0, -6.0}) {
    cells.push_back(
        {std::make_shared<RegistrationTarget>(target_at(street(), along_x(x))), along_x(x)});
  }
  return cells;
}

TEST(AlongStreet, TheRightPoseIsAmongTheStartsOfAWrongOne) {
  const std::vector<CellAround> cells = cells_of_the_street();
  for (const double off : {-3.5, -1.5, 2.0, 3.25}) {
    const std::vector<Pose> starts = starts_when_off_by(off, cells);
    EXPECT_TRUE(std::any_of(starts.begin(), starts.end(), [](const Pose& T) {
      return T.translation().norm() < 0.3;
    })) << off;
  }
}

TEST(AlongStreet, StartsLieOnTheStreetAndApartFromWhereTheScanIsThoughtToBe) {
  const std::vector<Pose> starts = starts_when_off_by(0.0, cells_of_the_street());
  EXPECT_LE(starts.size(), 4u);
  for (const Pose& T : starts) {
    EXPECT_NEAR(T.translation().tail<2>().norm(), 0.0, 1e-9);
    EXPECT_GE(std::abs(T.translation().x()), 0.75 - 1e-9);
    EXPECT_LE(std::abs(T.translation().x()), 4.0 + 1e-9);
  }
}

TEST(Rivals, HaveEvenOddsWhereTheCellsAroundCannotTellThemApart) {
  const SurroundingsScores pose{7, 20, 0.7, 0.6};
  EXPECT_DOUBLE_EQ(odds_against(pose, pose), 1.0);
  EXPECT_LT(odds_against(pose, {7, 20, 0.5, 0.6}), 0.01);
  EXPECT_GT(odds_against(pose, {7, 20, 0.9, 0.6}), 100);
  EXPECT_EQ(odds_against(pose, {1, 20, 0.9, 0.9}), 0.0) << "one CELL is not enough to ask";
}

}  // namespace
}  // namespace cellmap
