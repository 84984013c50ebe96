#include "cellmap/geometry/pose.hpp"

#include <gtest/gtest.h>

#include <random>
#include <unsupported/Eigen/MatrixFunctions>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

Tangent random_tangent(std::mt19937& rng, double scale) {
  std::normal_distribution<double> normal(0, scale);
  Tangent xi;
  for (double& v : xi) v = normal(rng);
  return xi;
}

Eigen::Matrix4d hat(const Tangent& xi) {
  Eigen::Matrix4d X = Eigen::Matrix4d::Zero();
  X.topLeftCorner<3, 3>() = skew(xi.tail<3>());
  X.topRightCorner<3, 1>() = xi.head<3>();
  return X;
}

TEST(Pose, ExpIsTheMatrixExponential) {
  std::mt19937 rng(1);
  for (const double scale : {1e-7, 1e-4, 0.1, 1.0}) {
    for (int i = 0; i < 50; ++i) {
      const Tangent xi = random_tangent(rng, scale);
      const Eigen::Matrix4d expected = hat(xi).exp();
      EXPECT_LT((exp(xi).matrix() - expected).norm(), 1e-9 * (1 + xi.norm()));
    }
  }
}

TEST(Pose, LogInvertsExp) {
  std::mt19937 rng(2);
  for (const double scale : {1e-7, 1e-4, 0.1, 0.8}) {
    for (int i = 0; i < 50; ++i) {
      const Tangent xi = random_tangent(rng, scale);
      EXPECT_LT((log(exp(xi)) - xi).norm(), 1e-9 * (1 + xi.norm()));
    }
  }
}

TEST(Pose, AdjointMovesAPerturbationFromTheRightToTheLeft) {
  std::mt19937 rng(3);
  for (int i = 0; i < 50; ++i) {
    const Pose T = exp(random_tangent(rng, 1.0));
    const Tangent xi = random_tangent(rng, 0.1);
    EXPECT_LT(((T * exp(xi) * T.inverse()).matrix() - exp(adjoint(T) * xi).matrix()).norm(), 1e-9);
  }
}

TEST(Pose, InterpolationHitsBothEndsAndIsHalfwayInBetween) {
  std::mt19937 rng(4);
  const Pose T_a = exp(random_tangent(rng, 1.0)), T_b = exp(random_tangent(rng, 1.0));
  EXPECT_LT((interpolate(T_a, T_b, 0).matrix() - T_a.matrix()).norm(), 1e-12);
  EXPECT_LT((interpolate(T_a, T_b, 1).matrix() - T_b.matrix()).norm(), 1e-9);
  const Pose middle = interpolate(T_a, T_b, 0.5);
  EXPECT_NEAR(angle_between_rad(T_a, middle), angle_between_rad(middle, T_b), 1e-9);
}

TEST(Pose, NumbersThatAreNoPoseAreRefused) {
  const std::array<double, 7> unnormalised = {0, 0, 0, 0, 0, 0, 2};
  const std::array<double, 7> not_finite = {NAN, 0, 0, 0, 0, 0, 1};
  const std::array<double, 12> mirrored = {-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  EXPECT_THROW(pose_from_xyz_qxyzw(unnormalised), Error);
  EXPECT_THROW(pose_from_xyz_qxyzw(not_finite), Error);
  EXPECT_THROW(pose_from_row_major_3x4(mirrored), Error);
}

TEST(Pose, QuaternionFormRoundTrips) {
  std::mt19937 rng(5);
  const Pose T = exp(random_tangent(rng, 1.0));
  EXPECT_LT((pose_from_xyz_qxyzw(to_xyz_qxyzw(T)).matrix() - T.matrix()).norm(), 1e-12);
}

}  // namespace
}  // namespace cellmap
