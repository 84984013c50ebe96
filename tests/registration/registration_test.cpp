#include "cellmap/registration/registration.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "support/expect_error.hpp"
#include "support/registration_world.hpp"

namespace cellmap {
namespace {

using test::BoxScene;
using test::level_pose;
using test::target_at;

double translation_error_m(const Pose& estimate, const Pose& truth) {
  return (estimate.translation() - truth.translation()).norm();
}

Pose small_error(double x, double y, double z, double roll_deg, double pitch_deg, double yaw_deg) {
  Tangent xi;
  xi << x, y, z, BoxScene::radians(roll_deg), BoxScene::radians(pitch_deg),
      BoxScene::radians(yaw_deg);
  return exp(xi);
}

TEST(RegisterScan, FindsAKnownPoseToTheMillimetre) {
  const BoxScene scene = test::street();
  const RegistrationTarget target = target_at(scene, level_pose(0, 0, 0));
  const Pose truth = level_pose(6.0, 0.4, 3.0);
  const PointCloud scan = scene.scan(truth);

  const RegistrationResult result =
      register_scan(target, scan, small_error(0.2, -0.2, 0.1, 0.3, -0.3, 0.9) * truth);

  EXPECT_TRUE(result.converged);
  EXPECT_TRUE(is_acceptable(result, {}));
  EXPECT_LT(translation_error_m(result.T_target_source, truth), 1e-3);
  EXPECT_LT(angle_between_rad(result.T_target_source, truth), 1e-4);
}

TEST(RegisterScan, ConvergesFromAMetreAndThreeDegrees) {
  const BoxScene scene = test::street();
  const BoxScene::Sensor noisy{.noise_m = 0.02};
  const RegistrationTarget target = target_at(scene, level_pose(0, 0, 0), noisy);
  const Pose truth = level_pose(5.0, -0.3, -2.0);
  const PointCloud scan = scene.scan(truth, {.noise_m = 0.02, .seed = 9});
  for (const double sign : {1.0, -1.0}) {
    const Pose start = small_error(0.7 * sign, -0.7, 0.1, 0.5, 0.5, 3 * sign) * truth;
    const RegistrationResult result = register_scan(target, scan, start);
    EXPECT_TRUE(result.converged);
    EXPECT_LT(translation_error_m(result.T_target_source, truth), 0.01);
    EXPECT_LT(angle_between_rad(result.T_target_source, truth), BoxScene::radians(0.05));
  }
}

TEST(RegisterScan, AScanOfAnotherPlaceIsNotAccepted) {
  const RegistrationTarget target = target_at(test::street(), level_pose(0, 0, 0));
  BoxScene elsewhere;
  elsewhere.add({-300, -300, -2.7}, {300, 300, -1.7});
  elsewhere.add({8, -40, -1.7}, {12, 2, 6});
  elsewhere.add({-25, 4, -1.7}, {-3, 30, 6});
  elsewhere.add({-9, -30, -1.7}, {-5, -6, 6});
  const RegistrationResult result =
      register_scan(target, elsewhere.scan(level_pose(0, 0, 0)), Pose::Identity());
  EXPECT_FALSE(is_acceptable(result, {}));
}

TEST(RegisterScan, TooFewPointsOnPlanesIsNotConverged) {
  const RegistrationTarget target = target_at(test::street(), level_pose(0, 0, 0));
  PointCloud up;
  for (int i = 0; i < 500; ++i) up.push_back({0.01F * static_cast<float>(i % 20), 0.1F, 30.0F});
  const RegistrationResult result = register_scan(target, up, Pose::Identity());
  EXPECT_FALSE(result.converged);
  EXPECT_EQ(result.scores.hits, 0U);
  EXPECT_TRUE(result.information.isZero());
  EXPECT_FALSE(register_scan(target, PointCloud{}, Pose::Identity()).converged);
}

TEST(RegisterScan, AlongACorridorTheWeakDirectionIsNamed) {
  const BoxScene scene = test::corridor();
  const BoxScene::Sensor noisy{.noise_m = 0.01};
  const RegistrationTarget target = target_at(scene, level_pose(0, 0, 0), noisy);
  const PointCloud scan = scene.scan(level_pose(2.0, 0, 0), {.noise_m = 0.01, .seed = 5});

  const RegistrationResult result = register_scan(target, scan, level_pose(2.0, 0.1, 1.0));

  EXPECT_TRUE(result.degeneracy.degenerate);
  EXPECT_GT(std::abs(result.degeneracy.weakest[0]), 0.95);
  const Matrix6d covariance = result.information.inverse();
  EXPECT_GT(covariance(0, 0), 10 * covariance(1, 1));
  EXPECT_GT(covariance(0, 0), 10 * covariance(2, 2));

  const RegistrationTarget in_street = target_at(test::street(), level_pose(0, 0, 0), noisy);
  const RegistrationResult held =
      register_scan(in_street, test::street().scan(level_pose(2, 0, 0)), level_pose(2, 0.1, 1));
  EXPECT_FALSE(held.degeneracy.degenerate);
}

TEST(RegisterCells, FindsAKnownPoseToTheMillimetreAndItsInverseWhenSwapped) {
  const BoxScene scene = test::street();
  const Pose T_w_a = level_pose(0, 0, 0), T_w_b = level_pose(6.2, 0.5, 4.0);
  const RegistrationTarget a = target_at(scene, T_w_a), b = target_at(scene, T_w_b);
  const PointCloud scan_a = scene.scan(T_w_a), scan_b = scene.scan(T_w_b);
  const Pose truth = T_w_a.inverse() * T_w_b;
  const Pose start = small_error(0.2, 0.2, -0.1, 0.2, -0.2, 1.0) * truth;

  const RegistrationResult ab = register_cells(a, scan_a, b, scan_b, start);
  const RegistrationResult ba = register_cells(b, scan_b, a, scan_a, start.inverse());

  EXPECT_TRUE(ab.converged);
  EXPECT_LT(translation_error_m(ab.T_target_source, truth), 1e-3);
  EXPECT_LT(translation_error_m(ba.T_target_source.inverse(), ab.T_target_source), 1e-3);
  EXPECT_EQ(ab.scores.points, scan_a.size() + scan_b.size());
}

TEST(RegisterScan, UnjudgedThePoseIsTheSameAndTheResultIsNotAccepted) {
  const BoxScene scene = test::street();
  const RegistrationTarget target = target_at(scene, level_pose(0, 0, 0));
  const Pose truth = level_pose(3, 0.2, 2);
  const PointCloud scan = scene.scan(truth);
  RegistrationOptions options;
  const RegistrationResult judged = register_scan(target, scan, truth, options);
  options.judge = false;
  const RegistrationResult unjudged = register_scan(target, scan, truth, options);
  EXPECT_EQ(unjudged.T_target_source.matrix(), judged.T_target_source.matrix());
  EXPECT_TRUE(is_acceptable(judged, {}));
  EXPECT_TRUE(unjudged.converged);
  EXPECT_TRUE(unjudged.information.isZero());
  EXPECT_FALSE(is_acceptable(unjudged, {}));
}

TEST(RegisterCells, TheResultDoesNotDependOnTheThreads) {
  const BoxScene scene = test::street();
  const Pose T_w_b = level_pose(6.2, 0.5, 4.0);
  const RegistrationTarget a = target_at(scene, level_pose(0, 0, 0)), b = target_at(scene, T_w_b);
  const PointCloud scan_a = scene.scan(level_pose(0, 0, 0)), scan_b = scene.scan(T_w_b);
  RegistrationOptions options;
  const RegistrationResult serial = register_cells(a, scan_a, b, scan_b, T_w_b, options);
  options.threads = 3;
  const RegistrationResult parallel = register_cells(a, scan_a, b, scan_b, T_w_b, options);
  EXPECT_EQ(serial.T_target_source.matrix(), parallel.T_target_source.matrix());
  EXPECT_EQ(serial.information, parallel.information);
}

TEST(RegisterScan, TheCovarianceIsAsLargeAsTheErrorsOfRepeatedNoise) {
  // One CELL, twelve scans that differ by their noise only: what varies between them is what the
  // residuals tell of, so the systematic part is left out.
  const BoxScene scene = test::street();
  const RegistrationTarget target = target_at(scene, level_pose(0, 0, 0), {.noise_m = 0.02});
  RegistrationOptions options;
  options.systematic_translation_m = 0;
  options.systematic_rotation_deg = 0;
  const Pose truth = level_pose(3, 0.2, 2);
  double squared = 0;
  constexpr int kRuns = 12;
  for (unsigned run = 0; run < kRuns; ++run) {
    const PointCloud scan =
        scene.scan(truth, {.beams = 32, .azimuths = 450, .noise_m = 0.02, .seed = 100 + run});
    const RegistrationResult result = register_scan(target, scan, truth, options);
    const Tangent error = log(result.T_target_source * truth.inverse());
    squared += error.dot(result.information * error) / 6;
  }
  EXPECT_LT(squared / kRuns, 3.0) << "too sure of itself";
  EXPECT_GT(squared / kRuns, 0.02) << "far too modest";
}

TEST(IsAcceptable, AsksForConvergenceAndForEveryScore) {
  RegistrationResult good;
  good.converged = true;
  good.scores = {1000, 700, 0.65, 0.95, 0.001, 0.01, 0.02};
  EXPECT_TRUE(is_acceptable(good, {}));
  RegistrationResult result = good;
  result.converged = false;
  EXPECT_FALSE(is_acceptable(result, {}));
  result = good;
  result.scores.inlier_ratio_hit = 0.5;
  EXPECT_FALSE(is_acceptable(result, {}));
  result = good;
  result.scores.share_in_front = 0.3;
  EXPECT_FALSE(is_acceptable(result, {}));
  result = good;
  result.scores.median_residual_m = 0.3;
  EXPECT_FALSE(is_acceptable(result, {}));
  result = good;
  result.scores.hits = 50;
  EXPECT_FALSE(is_acceptable(result, {}));
}

TEST(RegistrationOptions, ValuesOutOfTheirRangesAreRefusedByName) {
  RegistrationOptions options;
  options.point_step = 0;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { options.validate(); }, "point_step");
  AcceptanceOptions acceptance;
  acceptance.min_hit_share = 2;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { acceptance.validate(); }, "min_hit_share");
}

}  // namespace
}  // namespace cellmap
