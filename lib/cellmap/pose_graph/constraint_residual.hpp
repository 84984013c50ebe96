#pragma once

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// What a constraint says of two poses. With (R, t) = T_from^-1 * T_to and the measurement (M, m):
///
///   S * (t - m, 2 vec(q)),   q the quaternion of R * M^T with w >= 0,
///
/// the error of the position in the axes of `from`, and that of the rotation to second order. It is
/// the residual of the pose-graph example that comes with Ceres, has derivatives without a series,
/// and is linear in the positions. The error of the left perturbation exp(xi) * T_from_to is, to
/// first order, (rho + phi x m, phi); so S^T * S = A^T * information * A with A = [I, [m]x; 0, I].
class ConstraintResidual {
 public:
  explicit ConstraintResidual(const Constraint& constraint);

  /// In sigmas.
  Tangent error(const Pose& T_from, const Pose& T_to) const;

  /// The error and its derivatives by right perturbations, T_from * exp(d) and T_to * exp(d). Such
  /// a step turns a whole stretch of a drift about one point without any error of linearisation.
  struct Linear {
    Tangent error;
    Matrix6d by_from, by_to;
  };
  Linear linearise(const Pose& T_from, const Pose& T_to) const;

 private:
  Pose T_from_to_;
  Matrix6d whitening_;
};

}  // namespace cellmap
