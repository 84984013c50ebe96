#include "cellmap/simulation/odometry_model.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/evaluation/trajectory_metrics.hpp"
#include "cellmap/simulation/route.hpp"

namespace cellmap::simulation {
namespace {

Route straight(double length_m, double step_m) {
  Route route;
  for (double x = 0; x <= length_m + 1e-9; x += step_m) {
    StampedPose sample{static_cast<Stamp>(route.size()) * 100'000'000, Pose::Identity()};
    sample.pose.translation().x() = x;
    route.push_back(sample);
  }
  return route;
}

DriftModel without_errors() {
  DriftModel model;
  model.forward_noise_m = model.sideways_noise_m = model.rotation_noise_deg = 0;
  model.scale_bias = model.yaw_bias_deg_per_m = model.pitch_bias_deg_per_m = model.turn_bias = 0;
  return model;
}

/// Root mean square over many seeds of how far the last pose is off along `axis`.
double rms_end_error_m(const Route& truth, const DriftModel& model, int axis) {
  constexpr int seeds = 400;
  double sum = 0;
  for (int seed = 0; seed < seeds; ++seed) {
    const Route odometry = drifted(truth, model, static_cast<std::uint64_t>(seed));
    const double error =
        (odometry.back().pose.translation() - truth.back().pose.translation())[axis];
    sum += error * error;
  }
  return std::sqrt(sum / seeds);
}

TEST(DriftModel, WithoutErrorsIsTheTruth) {
  const Route truth = town_route(10), odometry = drifted(truth, without_errors(), 1);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    ASSERT_TRUE(odometry[i].pose.isApprox(truth[i].pose, 1e-9)) << i;
    ASSERT_EQ(odometry[i].stamp, truth[i].stamp);
  }
}

TEST(DriftModel, AddsNoiseWhoseVarianceGrowsWithTheDistanceWhateverTheStep) {
  DriftModel model = without_errors();
  model.forward_noise_m = 0.02;
  // The sum of independent errors over L metres has deviation sigma sqrt(L). 400 draws estimate a
  // deviation to 3.5 %; four of those are allowed.
  EXPECT_NEAR(rms_end_error_m(straight(100, 1.0), model, 0), 0.02 * 10, 0.14 * 0.02 * 10);
  EXPECT_NEAR(rms_end_error_m(straight(100, 0.5), model, 0), 0.02 * 10, 0.14 * 0.02 * 10);
  EXPECT_NEAR(rms_end_error_m(straight(400, 1.0), model, 0), 0.02 * 20, 0.14 * 0.02 * 20);
}

TEST(DriftModel, AddsABiasWithTheStatedCorrelationLength) {
  DriftModel model = without_errors();
  model.scale_bias = 0.01;
  model.correlation_m = 50;
  // Variance of the integral of a Gauss-Markov process: 2 s^2 c (L - c (1 - exp(-L / c))).
  const double L = 300, c = 50;
  const double expected = 0.01 * std::sqrt(2 * c * (L - c * (1 - std::exp(-L / c))));
  EXPECT_NEAR(rms_end_error_m(straight(300, 1.0), model, 0), expected, 0.14 * expected);
}

TEST(DriftModel, TurnsAYawBiasIntoSidewaysError) {
  DriftModel model = without_errors();
  model.yaw_bias_deg_per_m = 0.01;
  model.correlation_m = 1e9;  // constant: y = b L^2 / 2
  const double expected = 0.01 * std::numbers::pi / 180 * 100 * 100 / 2;
  EXPECT_NEAR(rms_end_error_m(straight(100, 1.0), model, 1), expected, 0.14 * expected);
}

TEST(DriftModel, DoesNotDriftWhileStandingStill) {
  Route truth = straight(10, 1.0);
  for (int i = 0; i < 100; ++i) truth.push_back({truth.back().stamp + 1, truth.back().pose});
  const Route odometry = drifted(truth, DriftModel{}, 3);

  EXPECT_TRUE(odometry.back().pose.isApprox(odometry[10].pose, 1e-9));
  EXPECT_FALSE(odometry[10].pose.isApprox(truth[10].pose, 1e-6));
}

TEST(DriftModel, DriftsByHalfToOnePerCentOverAKilometre) {
  const Route truth = town_route(10);
  std::vector<double> t_rel_percent;
  for (std::uint64_t seed = 0; seed < 31; ++seed) {
    const Route odometry = drifted(truth, DriftModel{}, seed);
    t_rel_percent.push_back(
        evaluate_trajectory(Trajectory(odometry), Trajectory(truth)).t_rel_percent);
  }
  std::sort(t_rel_percent.begin(), t_rel_percent.end());
  EXPECT_GT(t_rel_percent[15], 0.45);
  EXPECT_LT(t_rel_percent[15], 1.0);
}

TEST(DriftModel, IsTheSameForTheSameSeedAndAnotherForAnother) {
  const Route truth = straight(50, 1.0);
  const auto end = [&](std::uint64_t seed) {
    return Eigen::Vector3d(drifted(truth, DriftModel{}, seed).back().pose.translation());
  };
  EXPECT_EQ(end(5), end(5));
  EXPECT_NE(end(5), end(6));
}

}  // namespace
}  // namespace cellmap::simulation
