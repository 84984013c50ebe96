#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// One direction of a registration: a scan seen by a CELL. Forward where the pose that is sought
/// moves the scan into the CELL's frame (T * p), reverse where its inverse does (T^-1 * p).
struct RegistrationTerm {
  const RegistrationTarget* target;
  const PointCloud* scan;
  bool reverse = false;
};

/// A point's distance from the plane that its direction meets (paper, Eq. 1) and the derivative of
/// that distance for the left perturbation exp(xi) * T (paper, Eq. 2 to 5).
struct Residual {
  std::int32_t plane = -1;  ///< position in the CELL's planes; -1: the direction has none
  double distance_m = 0;    ///< along the normal; positive on the side of the CELL's origin
  Tangent jacobian = Tangent::Zero();
};

/// The residual of one point of a term's scan at the pose `T`.
Residual evaluate(const RegistrationTerm& term, const Pose& T, std::size_t point);

/// Which points take part, and on how many threads they are summed.
struct PointSelection {
  std::size_t step = 1;
  int threads = 1;
};

/// Signed distances of a term's points from their planes; points without a plane are left out.
struct HitDistances {
  std::size_t points = 0;  ///< looked at, with or without a plane
  std::vector<float> distance_m;
  std::vector<std::int32_t> plane;  ///< same length
};
HitDistances hit_distances(const RegistrationTerm& term, const Pose& T,
                           const PointSelection& selection);

/// Sums of a weighted least-squares problem over points: the normal equations H xi = -g.
struct NormalSystem {
  Matrix6d H = Matrix6d::Zero();
  Tangent g = Tangent::Zero();
  std::size_t points = 0;  ///< that had a weight
};

/// Normal equations of all points of all terms within the stage's gate, weighted by its kernel.
NormalSystem normal_system(std::span<const RegistrationTerm> terms, const Pose& T,
                           const RegistrationStage& stage, const PointSelection& selection);

/// The matrix H of the points of one term within `gate_m` of their planes, each with the weight of
/// its plane; g stays zero.
NormalSystem plane_weighted_system(const RegistrationTerm& term, const Pose& T, double gate_m,
                                   std::span<const double> weight_of_plane,
                                   const PointSelection& selection);

}  // namespace cellmap
