#include "cellmap/pose_graph/information.hpp"

#include <Eigen/Cholesky>

namespace cellmap {
namespace {

/// A perturbation about the source's origin t, in the axes of `from`: rho_left = rho + t x phi.
Matrix6d left_from_source(const Pose& T_from_to) {
  Matrix6d A = Matrix6d::Identity();
  A.topRightCorner<3, 3>() = skew(T_from_to.translation());
  return A;
}

Matrix6d symmetric(const Matrix6d& M) { return 0.5 * (M + M.transpose()); }

}  // namespace

Matrix6d information_of(const PoseSigma& sigma, const Pose& T_from_to) {
  Tangent weight;
  weight.head<3>().setConstant(1.0 / (sigma.translation_m * sigma.translation_m));
  weight.tail<3>().setConstant(1.0 / (sigma.rotation_rad * sigma.rotation_rad));
  const Matrix6d A = left_from_source(T_from_to).inverse();
  return symmetric(A.transpose() * weight.asDiagonal() * A);
}

Matrix6d realistic_information(const Matrix6d& information, const Pose& T_from_to,
                               const PoseSigma& floor) {
  // (I^-1 + F^-1)^-1 = F - F (I + F)^-1 F needs no inverse of I, which may be singular.
  const Matrix6d F = information_of(floor, T_from_to);
  const Matrix6d sum = symmetric(information) + F;
  return symmetric(F - F * sum.ldlt().solve(F));
}

}  // namespace cellmap
