#include "cellmap/registration/residuals.hpp"

#include <gtest/gtest.h>

#include "support/registration_world.hpp"

namespace cellmap {
namespace {

using test::level_pose;

TEST(Residuals, JacobiansOfBothDirectionsAreTheNumericDerivatives) {
  const test::BoxScene scene = test::street();
  const RegistrationTarget target = test::target_at(scene, level_pose(0, 0, 0));
  const Pose T = level_pose(3.0, 0.5, 20.0);
  const PointCloud forward_scan = scene.scan(T), reverse_scan = scene.scan(T.inverse());
  const RegistrationTerm forward{&target, &forward_scan, false};
  const RegistrationTerm reverse{&target, &reverse_scan, true};
  constexpr double kStep = 1e-6;
  for (const auto& [term, pose] : {std::pair{forward, T}, std::pair{reverse, T}}) {
    int compared = 0;
    for (std::size_t point = 0; point < term.scan->size(); point += 97) {
      const Residual at = evaluate(term, pose, point);
      if (at.plane < 0) continue;
      for (int k = 0; k < 6; ++k) {
        const Tangent up = kStep * Tangent::Unit(k);
        const Residual plus = evaluate(term, exp(up) * pose, point);
        const Residual minus = evaluate(term, exp(Tangent(-up)) * pose, point);
        if (plus.plane != at.plane || minus.plane != at.plane) continue;
        const double numeric = (plus.distance_m - minus.distance_m) / (2 * kStep);
        EXPECT_NEAR(at.jacobian[k], numeric, 1e-6 * (1 + std::abs(numeric))) << k;
        ++compared;
      }
    }
    EXPECT_GT(compared, 500);
  }
}

TEST(Residuals, NormalEquationsDoNotDependOnTheThreads) {
  const test::BoxScene scene = test::street();
  const RegistrationTarget target = test::target_at(scene, level_pose(0, 0, 0));
  const Pose T = level_pose(3.0, 0.5, 5.0);
  const PointCloud scan = scene.scan(T);
  const RegistrationTerm term{&target, &scan, false};
  const RegistrationStage stage{1, 0.5, RobustKernel::kGemanMcClure, 0.05};
  NormalSystem one, four;
  MatchedTerm(term, 1).add_normal_equations(T, stage, one);
  MatchedTerm(term, 4).add_normal_equations(T, stage, four);
  EXPECT_EQ(one.H, four.H);
  EXPECT_EQ(one.g, four.g);
  EXPECT_EQ(one.points, four.points);
}

}  // namespace
}  // namespace cellmap
