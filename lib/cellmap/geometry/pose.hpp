#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <span>

namespace cellmap {

/// A rigid transform, SE(3). Named `T_target_source`: p_target = T_target_source * p_source.
using Pose = Eigen::Isometry3d;

/// An element of se(3), ordered translation first: (rho_x, rho_y, rho_z, phi_x, phi_y, phi_z), in
/// metres and radians. This order holds for every tangent vector, Jacobian, information and
/// covariance matrix of the project.
using Tangent = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// The cross-product matrix: skew(a) * b = a x b.
Eigen::Matrix3d skew(const Eigen::Vector3d& a);

/// Exponential map of SE(3); exact for all angles, series below 1e-4 rad.
Pose exp(const Tangent& xi);

/// Logarithm of SE(3), the inverse of `exp`; the rotation vector has a norm of at most pi.
Tangent log(const Pose& T);

/// Adjoint: T * exp(xi) * T^-1 = exp(adjoint(T) * xi).
Matrix6d adjoint(const Pose& T);

/// Geodesic interpolation: T_a * exp(t * log(T_a^-1 * T_b)); t = 0 gives T_a, t = 1 gives T_b.
Pose interpolate(const Pose& T_a, const Pose& T_b, double t);

/// The angle of the rotation between the two, in [0, pi] rad.
double angle_between_rad(const Pose& T_a, const Pose& T_b);

/// A pose from a translation in metres and a quaternion (x, y, z, w), normalised here.
/// Throws Error{kInvalidArgument} where a value is not finite or the quaternion's norm is not
/// within 1e-3 of 1.
Pose pose_from_xyz_qxyzw(std::span<const double, 7> values);

/// Inverse of `pose_from_xyz_qxyzw`, with w >= 0.
std::array<double, 7> to_xyz_qxyzw(const Pose& T);

/// A pose from a row-major 3x4 matrix [R | t] (the row of a KITTI pose file). The rotation is
/// projected to SO(3). Throws Error{kInvalidArgument} where a value is not finite or R is further
/// than `tolerance` from a rotation (Frobenius norm).
Pose pose_from_row_major_3x4(std::span<const double, 12> values, double tolerance = 1e-2);

/// True where every entry is finite and the linear part is a rotation within 1e-6.
bool is_rigid(const Pose& T);

}  // namespace cellmap
