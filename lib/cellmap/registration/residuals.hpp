#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
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

/// Signed distances of a term's points from their planes; points without a plane are left out.
struct HitDistances {
  std::size_t points = 0;  ///< looked at, with or without a plane
  std::vector<float> distance_m;
  std::vector<std::uint32_t> plane;  ///< position in the CELL's planes; same length
};

/// Sums of a weighted least-squares problem over points: the normal equations H xi = -g for the
/// left perturbation exp(xi) * T.
struct NormalSystem {
  Matrix6d H = Matrix6d::Zero();
  Tangent g = Tangent::Zero();
  std::size_t points = 0;  ///< that had a weight
};

/// Until when planes that were looked up at one pose serve others
/// (RegistrationOptions::reuse_share): while rotation plus translation over the median range stay
/// within this. 0: never.
struct ReuseBound {
  double median_range_m = 0;
  double angle_rad = 0;
};

/// All points of a term and the plane that each of them met when it was last looked up.
/// Points are moved, looked up and summed in blocks that stay in the nearest cache, in float
/// (simd/residuals.hpp); sums of blocks are added in double in a fixed order, so that results do
/// not depend on the number of threads. Memory: 4 bytes a point. The term's scan and target must
/// outlive it.
class MatchedTerm {
 public:
  MatchedTerm(const RegistrationTerm& term, Effort effort, const ReuseBound& reuse = {});

  const RegistrationTerm& term() const { return term_; }

  /// Adds the normal equations at `T` of the points within the stage's gate, weighted by its
  /// kernel.
  void add_normal_equations(const Pose& T, const RegistrationStage& stage, NormalSystem& system);

  /// The points and their distances at `T`.
  HitDistances distances(const Pose& T);

  /// Adds the matrix H at `T` of the points within `gate_m`, each with the weight of its plane.
  void add_plane_weighted(const Pose& T, double gate_m, std::span<const double> weight_of_plane,
                          NormalSystem& system);

  /// Whether the last of these calls looked planes up rather than used earlier ones.
  bool is_fresh() const { return is_fresh_; }
  /// The next call looks up.
  void forget() { looked_up_at_.reset(); }

 private:
  bool serves(const Pose& T) const;
  std::uint32_t slot_of(std::size_t point) const;  // as RegistrationTarget::slot_of
  template <typename PerBlock>
  void visit(const Pose& T, const PerBlock& per_block);

  RegistrationTerm term_;
  Effort effort_;
  ReuseBound reuse_;
  std::optional<Pose> looked_up_at_;
  bool is_fresh_ = false;
  std::vector<std::uint32_t> places_;  // of their planes in the target's table
};

}  // namespace cellmap
