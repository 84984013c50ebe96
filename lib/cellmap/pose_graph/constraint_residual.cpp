#include "cellmap/pose_graph/constraint_residual.hpp"

#include <Eigen/Cholesky>
#include <cmath>

namespace cellmap {
namespace {

/// Below this the series of the coefficients is exact to 1e-15.
constexpr double kSmallAngleRad = 0.02;

Matrix6d algebra_adjoint(const Tangent& xi) {
  Matrix6d ad = Matrix6d::Zero();
  ad.topLeftCorner<3, 3>() = ad.bottomRightCorner<3, 3>() = skew(xi.tail<3>());
  ad.topRightCorner<3, 3>() = skew(xi.head<3>());
  return ad;
}

/// A matrix S with S^T S = information, which may be singular.
Matrix6d square_root(const Matrix6d& information) {
  const Eigen::LDLT<Matrix6d> ldlt(information);
  const Matrix6d P = ldlt.transpositionsP() * Matrix6d::Identity();
  return ldlt.vectorD().cwiseMax(0.0).cwiseSqrt().asDiagonal() * Matrix6d(ldlt.matrixU()) * P;
}

}  // namespace

Matrix6d inverse_right_jacobian(const Tangent& xi) {
  const double angle2 = xi.tail<3>().squaredNorm(), angle = std::sqrt(angle2);
  double a = 1.0 / 12.0 - angle2 * angle2 / 30240.0;
  double b = -1.0 / 720.0 - angle2 / 15120.0;
  if (angle > kSmallAngleRad) {
    // g(angle) is the even part of x / (1 - e^-x) at x = i angle.
    const double half = 0.5 * angle, cotangent = 1.0 / std::tan(half), sine = std::sin(half);
    const double g = half * cotangent;
    const double slope = 0.5 * cotangent - 0.25 * angle / (sine * sine);
    a = 2.0 * (1.0 - g) / angle2 + slope / (2.0 * angle);
    b = (1.0 - g) / (angle2 * angle2) + slope / (2.0 * angle2 * angle);
  }
  const Matrix6d ad = algebra_adjoint(xi);
  const Matrix6d ad2 = ad * ad;
  return Matrix6d::Identity() + 0.5 * ad + a * ad2 + b * (ad2 * ad2);
}

ConstraintResidual::ConstraintResidual(const Constraint& constraint)
    : T_to_from_(constraint.T_from_to.inverse()),
      whitening_(square_root(constraint.information) * adjoint(constraint.T_from_to)) {}

Tangent ConstraintResidual::error(const Pose& T_from, const Pose& T_to) const {
  return whitening_ * log(T_to_from_ * (T_from.inverse() * T_to));
}

ConstraintResidual::Linear ConstraintResidual::linearise(const Pose& T_from,
                                                         const Pose& T_to) const {
  const Pose T_from_to = T_from.inverse() * T_to;
  Linear linear;
  const Tangent xi = log(T_to_from_ * T_from_to);
  linear.error = whitening_ * xi;
  linear.by_to = whitening_ * inverse_right_jacobian(xi);
  // exp(-d) * T_from_to = T_from_to * exp(-Ad(T_from_to^-1) * d)
  linear.by_from = -linear.by_to * adjoint(T_from_to.inverse());
  return linear;
}

}  // namespace cellmap
