#include "cellmap/registration/residuals.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>

#include "support/instruction_sets.hpp"
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

/// Gauss-Newton on `evaluate` point by point in double: the slow twin of a registration.
Pose register_slowly(std::span<const RegistrationTerm> terms, Pose T, double width_m) {
  for (int i = 0; i < 40; ++i) {
    Matrix6d H = Matrix6d::Zero();
    Tangent g = Tangent::Zero();
    for (const RegistrationTerm& term : terms) {
      for (std::size_t point = 0; point < term.scan->size(); ++point) {
        const Residual at = evaluate(term, T, point);
        if (at.plane < 0 || std::abs(at.distance_m) > 0.5) continue;
        const double weight = 1 / std::pow(1 + std::pow(at.distance_m / width_m, 2), 2);
        H += weight * at.jacobian * at.jacobian.transpose();
        g += weight * at.jacobian * at.distance_m;
      }
    }
    T = exp(Tangent(-H.ldlt().solve(g))) * T;
  }
  return T;
}

TEST(Residuals, TheFastPathEndsWhereTheSlowTwinEndsOnEveryInstructionSet) {
  const test::BoxScene::Sensor sensor{.azimuths = 400, .noise_m = 0.01};
  const Pose T_true = level_pose(4.0, 0.3, 3.0);
  const RegistrationTarget a = test::target_at(test::street(), level_pose(0, 0, 0), sensor);
  const RegistrationTarget b = test::target_at(test::street(), T_true, sensor);
  const PointCloud scan_a = test::street().scan(level_pose(0, 0, 0), sensor);
  const PointCloud scan_b = test::street().scan(T_true, sensor);
  const std::array terms = {RegistrationTerm{&a, &scan_b, false},
                            RegistrationTerm{&b, &scan_a, true}};
  const Pose slow = register_slowly(terms, T_true, 0.05);
  RegistrationOptions options;
  options.stages = {{60, 0.5, RobustKernel::kGemanMcClure, 0.05}};
  options.convergence_translation_m = 1e-7;
  options.convergence_rotation_rad = 1e-8;
  test::for_each_instruction_set([&](const std::string& name) {
    const Pose fast = register_cells(a, scan_a, b, scan_b, T_true, options).T_target_source;
    EXPECT_LT((slow.translation() - fast.translation()).norm(), 1e-5) << name;
    EXPECT_LT(angle_between_rad(slow, fast), test::BoxScene::radians(1e-4)) << name;
  });
}

TEST(Residuals, EveryPointMeetsTheSamePlaneOnEveryInstructionSet) {
  const RegistrationTarget target = test::target_at(test::street(), level_pose(0, 0, 0));
  const Pose T = level_pose(3.0, 0.5, 5.0);
  const PointCloud scan = test::street().scan(T);
  std::vector<std::uint32_t> first;
  test::for_each_instruction_set([&](const std::string& name) {
    const HitDistances hits = MatchedTerm({&target, &scan}, 1).distances(T);
    if (first.empty()) first = hits.plane;
    EXPECT_EQ(hits.plane, first) << name;
  });
  EXPECT_GT(first.size(), scan.size() / 4);
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
