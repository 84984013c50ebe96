#include "cellmap/pipeline/refine.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

Pose at(double x, double y = 0) {
  Pose T = Pose::Identity();
  T.translation() << x, y, 0;
  return T;
}

/// Two CELLs 6 m apart along x, each with three scans 2 m apart.
std::vector<CellScans> straight_drive() {
  std::vector<CellScans> stretches;
  for (std::uint32_t cell = 0; cell < 2; ++cell) {
    CellScans stretch{{cell + 1}, at(6.0 * cell), {}};
    for (int i = 0; i < 3; ++i) stretch.scans.push_back({3 * cell + i, at(2.0 * i)});
    stretches.push_back(stretch);
  }
  return stretches;
}

TEST(CorrectedTrajectory, IsTheOdometryWhereNothingMoved) {
  const auto trajectory = corrected_trajectory(straight_drive(), {{{1}, at(0)}, {{2}, at(6)}});
  ASSERT_EQ(trajectory.size(), 6u);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_LT((trajectory[i].pose.matrix() - at(2.0 * static_cast<double>(i)).matrix()).norm(),
              1e-12);
  }
}

TEST(CorrectedTrajectory, SpreadsACorrectionByDistanceTravelled) {
  const auto trajectory = corrected_trajectory(straight_drive(), {{{1}, at(0)}, {{2}, at(6, 0.6)}});
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(trajectory[i].pose.translation().y(), 0.2 * static_cast<double>(i), 1e-12);
  }
  // The last CELL has no next one: its scans keep their poses relative to it.
  EXPECT_NEAR(trajectory[5].pose.translation().y(), 0.6, 1e-12);
  EXPECT_NEAR(trajectory[5].pose.translation().x(), 10, 1e-12);
}

TEST(CorrectedTrajectory, EveryCellsBaseScanHasTheCellsPose) {
  const Pose T_1 = exp((Tangent() << 1, 2, 3, 0.1, 0.2, 0.3).finished());
  const Pose T_2 = exp((Tangent() << 4, 2, 1, 0.3, -0.2, 0.1).finished());
  const auto trajectory = corrected_trajectory(straight_drive(), {{{1}, T_1}, {{2}, T_2}});
  EXPECT_LT((trajectory[0].pose.matrix() - T_1.matrix()).norm(), 1e-12);
  EXPECT_LT((trajectory[3].pose.matrix() - T_2.matrix()).norm(), 1e-12);
}

TEST(CorrectedTrajectory, RefusesACellWithoutAPose) {
  test::expect_error(
      ErrorCode::kInvalidArgument,
      [] {
        corrected_trajectory(straight_drive(), {{{1}, at(0)}});
      },
      "CELL 2");
}

}  // namespace
}  // namespace cellmap
