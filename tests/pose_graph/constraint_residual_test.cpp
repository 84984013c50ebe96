#include "cellmap/pose_graph/constraint_residual.hpp"

#include <gtest/gtest.h>

#include <random>

namespace cellmap {
namespace {

constexpr double kStep = 1e-5;

Tangent random_tangent(std::mt19937& rng, double translation, double rotation) {
  std::normal_distribution<double> normal;
  Tangent xi;
  for (int i = 0; i < 6; ++i) xi[i] = normal(rng) * (i < 3 ? translation : rotation);
  return xi;
}

TEST(ConstraintResidual, DerivativesAgreeWithNumericOnes) {
  std::mt19937 rng(2);
  for (int i = 0; i < 20; ++i) {
    Constraint constraint;
    constraint.from = {1};
    constraint.to = {2};
    constraint.T_from_to = exp(random_tangent(rng, 5, 0.8));
    const Pose T_from = exp(random_tangent(rng, 50, 1));
    const Pose T_to = T_from * constraint.T_from_to * exp(random_tangent(rng, 0.5, 0.3));
    const ConstraintResidual residual(constraint);
    const ConstraintResidual::Linear linear = residual.linearise(T_from, T_to);
    EXPECT_LT((linear.error - residual.error(T_from, T_to)).norm(), 1e-12);
    for (int axis = 0; axis < 6; ++axis) {
      const Pose plus = exp(kStep * Tangent::Unit(axis)), minus = plus.inverse();
      const Tangent by_from =
          (residual.error(T_from * plus, T_to) - residual.error(T_from * minus, T_to)) /
          (2 * kStep);
      const Tangent by_to =
          (residual.error(T_from, T_to * plus) - residual.error(T_from, T_to * minus)) /
          (2 * kStep);
      EXPECT_LT((linear.by_from.col(axis) - by_from).norm(), 1e-6 * (1 + by_from.norm()));
      EXPECT_LT((linear.by_to.col(axis) - by_to).norm(), 1e-6 * (1 + by_to.norm()));
    }
  }
}

TEST(ConstraintResidual, ItsSquareIsToFirstOrderThatOfTheLeftPerturbationInItsInformation) {
  std::mt19937 rng(3);
  for (const int rank : {6, 4, 1}) {
    Constraint constraint;
    constraint.T_from_to = exp(random_tangent(rng, 5, 0.8));
    Matrix6d A = Matrix6d::NullaryExpr([&] { return std::normal_distribution<>()(rng); });
    A.rightCols(6 - rank).setZero();
    constraint.information = A * A.transpose();
    const Tangent left = random_tangent(rng, 1e-5, 1e-5);
    const Tangent error =
        ConstraintResidual(constraint).error(Pose::Identity(), exp(left) * constraint.T_from_to);
    const double expected = left.dot(constraint.information * left);
    EXPECT_NEAR(error.squaredNorm(), expected, 1e-3 * constraint.information.trace() * 1e-10);
  }
}

}  // namespace
}  // namespace cellmap
