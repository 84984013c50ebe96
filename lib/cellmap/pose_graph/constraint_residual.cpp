#include "cellmap/pose_graph/constraint_residual.hpp"

#include <Eigen/Cholesky>

namespace cellmap {
namespace {

/// A matrix S with S^T S = information, which may be singular.
Matrix6d square_root(const Matrix6d& information) {
  const Eigen::LDLT<Matrix6d> ldlt(information);
  const Matrix6d P = ldlt.transpositionsP() * Matrix6d::Identity();
  return ldlt.vectorD().cwiseMax(0.0).cwiseSqrt().asDiagonal() * Matrix6d(ldlt.matrixU()) * P;
}

/// From (position error, rotation error) to the left perturbation.
Matrix6d left_from_error(const Eigen::Vector3d& measured_translation) {
  Matrix6d A = Matrix6d::Identity();
  A.topRightCorner<3, 3>() = skew(measured_translation);
  return A;
}

/// Of R * M^T, with w >= 0.
Eigen::Quaterniond rotation_error(const Pose& T_from_to, const Pose& measured) {
  Eigen::Quaterniond q(T_from_to.linear() * measured.linear().transpose());
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  return q;
}

}  // namespace

ConstraintResidual::ConstraintResidual(const Constraint& constraint)
    : T_from_to_(constraint.T_from_to) {
  const Matrix6d A = left_from_error(constraint.T_from_to.translation());
  whitening_ = square_root(A.transpose() * constraint.information * A);
}

Tangent ConstraintResidual::error(const Pose& T_from, const Pose& T_to) const {
  const Pose T = T_from.inverse() * T_to;
  Tangent error;
  error << T.translation() - T_from_to_.translation(), 2.0 * rotation_error(T, T_from_to_).vec();
  return whitening_ * error;
}

ConstraintResidual::Linear ConstraintResidual::linearise(const Pose& T_from,
                                                         const Pose& T_to) const {
  const Pose T = T_from.inverse() * T_to;
  const Eigen::Quaterniond q = rotation_error(T, T_from_to_);
  Tangent error;
  error << T.translation() - T_from_to_.translation(), 2.0 * q.vec();

  // A rotation by the small vector d is (1, d / 2): from the right q * (1, M d / 2), whose doubled
  // vector part is 2 v + (w I + [v]x) M d; from the left (1, -d / 2) * q.
  const Eigen::Matrix3d wI = q.w() * Eigen::Matrix3d::Identity(), v = skew(q.vec());
  const auto translation = whitening_.leftCols<3>(), rotation = whitening_.rightCols<3>();
  Linear linear;
  linear.error = whitening_ * error;
  linear.by_to << translation * T.linear(), rotation * ((wI + v) * T_from_to_.linear());
  linear.by_from << -translation, translation * skew(T.translation()) - rotation * (wI - v);
  return linear;
}

}  // namespace cellmap
