#pragma once

#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// The inverse of the right Jacobian of SE(3): log(exp(xi) * exp(d)) = xi + J * d + O(d^2).
///
/// J is the power series sum of B_n / n! * (-ad)^n with the Bernoulli numbers B_n, ad the adjoint
/// of the algebra, [[W(phi), W(rho)], [0, W(phi)]]. Because the eigenvalues of ad are 0 and
/// +-i|phi|, each double, the series is the polynomial I + ad / 2 + a ad^2 + b ad^4, whose a and b
/// make it agree with x / (1 - e^-x) in value and slope at the eigenvalues. Exact for |phi| < 2 pi.
Matrix6d inverse_right_jacobian(const Tangent& xi);

/// What a constraint says of two poses: S * log(T_from_to^-1 * T_from^-1 * T_to), whose S whitens
/// the *right* perturbation of the measurement. Because log(M^-1 T) = Ad(M)^-1 log(T M^-1),
/// S^T * S = Ad(M)^T * information * Ad(M).
class ConstraintResidual {
 public:
  explicit ConstraintResidual(const Constraint& constraint);

  /// In sigmas.
  Tangent error(const Pose& T_from, const Pose& T_to) const;

  /// The error and its derivatives by right perturbations, T_from * exp(d) and T_to * exp(d). Such
  /// a step turns a whole stretch of a drive about one point without any error of linearisation.
  struct Linear {
    Tangent error;
    Matrix6d by_from, by_to;
  };
  Linear linearise(const Pose& T_from, const Pose& T_to) const;

 private:
  Pose T_to_from_;
  Matrix6d whitening_;
};

}  // namespace cellmap
