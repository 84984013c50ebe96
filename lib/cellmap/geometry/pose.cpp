#include "cellmap/geometry/pose.hpp"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr double kSmallAngleRad = 1e-4;

/// V(phi) of SE(3): the translation of exp((rho, phi)) is V * rho.
Eigen::Matrix3d left_jacobian(const Eigen::Vector3d& phi) {
  const double angle2 = phi.squaredNorm();
  const double angle = std::sqrt(angle2);
  const Eigen::Matrix3d W = skew(phi);
  double a = 0.5 - angle2 / 24.0;
  double b = 1.0 / 6.0 - angle2 / 120.0;
  if (angle > kSmallAngleRad) {
    a = (1.0 - std::cos(angle)) / angle2;
    b = (angle - std::sin(angle)) / (angle2 * angle);
  }
  return Eigen::Matrix3d::Identity() + a * W + b * W * W;
}

Eigen::Quaterniond rotation_exp(const Eigen::Vector3d& phi) {
  const double half = 0.5 * phi.norm();
  const double sinc_half =
      half > kSmallAngleRad ? std::sin(half) / (2.0 * half) : 0.5 - half * half / 12.0;
  const Eigen::Vector3d v = sinc_half * phi;
  return Eigen::Quaterniond(std::cos(half), v.x(), v.y(), v.z()).normalized();
}

Eigen::Vector3d rotation_log(const Eigen::Matrix3d& R) {
  Eigen::Quaterniond q(R);
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const double n = q.vec().norm();
  const double scale = n > 1e-10 ? 2.0 * std::atan2(n, q.w()) / n : 2.0 / q.w();
  return scale * q.vec();
}

bool all_finite(std::span<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

}  // namespace

Eigen::Matrix3d skew(const Eigen::Vector3d& a) {
  Eigen::Matrix3d W;
  W << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return W;
}

Pose exp(const Tangent& xi) {
  Pose T = Pose::Identity();
  T.linear() = rotation_exp(xi.tail<3>()).toRotationMatrix();
  T.translation() = left_jacobian(xi.tail<3>()) * xi.head<3>();
  return T;
}

Tangent log(const Pose& T) {
  Tangent xi;
  xi.tail<3>() = rotation_log(T.linear());
  xi.head<3>() = left_jacobian(xi.tail<3>()).partialPivLu().solve(T.translation());
  return xi;
}

Matrix6d adjoint(const Pose& T) {
  Matrix6d A = Matrix6d::Zero();
  A.topLeftCorner<3, 3>() = T.linear();
  A.bottomRightCorner<3, 3>() = T.linear();
  A.topRightCorner<3, 3>() = skew(T.translation()) * T.linear();
  return A;
}

Pose interpolate(const Pose& T_a, const Pose& T_b, double t) {
  return T_a * exp(t * log(T_a.inverse() * T_b));
}

double angle_between_rad(const Pose& T_a, const Pose& T_b) {
  return rotation_log(T_a.linear().transpose() * T_b.linear()).norm();
}

Pose pose_from_xyz_qxyzw(std::span<const double, 7> values) {
  if (!all_finite(values)) {
    throw Error(ErrorCode::kInvalidArgument, "a pose has a value that is not a finite number");
  }
  const Eigen::Quaterniond q(values[6], values[3], values[4], values[5]);
  if (std::abs(q.norm() - 1.0) > 1e-3) {
    throw Error(ErrorCode::kInvalidArgument, "a pose's quaternion (qx qy qz qw) has the norm " +
                                                 std::to_string(q.norm()) + ", not 1");
  }
  Pose T = Pose::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() << values[0], values[1], values[2];
  return T;
}

std::array<double, 7> to_xyz_qxyzw(const Pose& T) {
  Eigen::Quaterniond q(T.linear());
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d t = T.translation();
  return {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()};
}

Pose pose_from_row_major_3x4(std::span<const double, 12> values, double tolerance) {
  if (!all_finite(values)) {
    throw Error(ErrorCode::kInvalidArgument, "a pose has a value that is not a finite number");
  }
  const Eigen::Map<const Eigen::Matrix<double, 3, 4, Eigen::RowMajor>> M(values.data());
  const Eigen::Matrix3d given = M.leftCols<3>();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(given, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d R = svd.matrixU() * svd.matrixV().transpose();
  if (R.determinant() < 0 || (R - given).norm() > tolerance) {
    throw Error(ErrorCode::kInvalidArgument, "a pose's 3x3 part is not a rotation matrix");
  }
  Pose T = Pose::Identity();
  T.linear() = R;
  T.translation() = M.col(3);
  return T;
}

bool is_rigid(const Pose& T) {
  return T.matrix().allFinite() &&
         (T.linear() * T.linear().transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-6 &&
         T.linear().determinant() > 0;
}

}  // namespace cellmap
