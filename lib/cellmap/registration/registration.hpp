#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/core/parallel.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/simd/plane_table.hpp"

namespace cellmap {

/// A CELL made ready to be registered to: the plane of any direction in one look-up.
/// Immutable and safe to share between threads. Memory: 4 bytes a lattice point plus 16 for each
/// from the lowest to the highest that has a plane: about 0.5 MB for N = 50,000.
class RegistrationTarget {
 public:
  RegistrationTarget(std::shared_ptr<const Cell> cell, std::shared_ptr<const Lattice> lattice);

  const Cell& cell() const { return *cell_; }
  const Lattice& lattice() const { return *lattice_; }

  /// The slot of the plane of a lattice point: its position in cell().planes plus 1; 0 where the
  /// patch has none.
  std::uint32_t slot_of(std::uint32_t lattice_index) const { return slots_[lattice_index]; }
  /// The plane of a slot as `plane_table` has it; slot 0 is infinitely far from every point.
  const simd::HessePlane& hesse_plane(std::uint32_t slot) const {
    return slot == 0 ? hesse_planes_.back() : hesse_planes_[cell_->indices[slot - 1] - first_];
  }
  /// Normal and offset n . (distance * direction) by lattice point: the point-to-plane distance is
  /// n . p - offset. One look-up a point instead of two.
  simd::PlaneTable plane_table() const {
    return {hesse_planes_.data(), first_, static_cast<std::uint32_t>(hesse_planes_.size() - 1)};
  }

 private:
  std::shared_ptr<const Cell> cell_;
  std::shared_ptr<const Lattice> lattice_;
  std::vector<std::uint32_t> slots_;
  std::uint32_t first_ = 0;                     // lowest lattice point that has a plane
  std::vector<simd::HessePlane> hesse_planes_;  // from there to the highest, and one more
};

enum class RobustKernel { kNone, kCauchy, kGemanMcClure };

/// A run of iterations with one gate and one kernel.
struct RegistrationStage {
  int max_iterations = 1;
  double gate_m = 1.0;  ///< points farther than this from their plane take no part
  RobustKernel kernel = RobustKernel::kNone;
  double kernel_width_m = 0.05;
  /// Above this many selected points, only every n-th of a scan takes part so that no more do: far
  /// from the answer a few thousand say the same as all. 0: all.
  std::size_t max_points = 0;
};

/// The schedule that an empty `RegistrationOptions::stages` stands for: plain least squares through
/// gates of 2, 1 and 0.5 m (4, 3 and 3 iterations), which brings 1 m / 3 deg into reach, then
/// Geman-McClure of 0.05 m width, which takes away the bias of occlusion edges: 6 iterations, still
/// on at most 20,000 points a scan, and then on all until the update is small, at most 30 times.
std::vector<RegistrationStage> default_registration_stages();

struct RegistrationOptions {
  /// Run in this order; empty: `default_registration_stages()`. Only the last one ends early: the
  /// others run all their iterations.
  std::vector<RegistrationStage> stages;
  /// An update smaller than both in the last stage means converged. On real CELLs, whose planes
  /// average scans that were stacked with odometry error, the last digits come slowly: a tenth of
  /// these costs twice the iterations and moves the pose by less than a millimetre.
  double convergence_translation_m = 5e-4;
  double convergence_rotation_rad = 5e-5;
  /// Every n-th point takes part, in every iteration and in the scores; 1: all, as in the paper.
  std::size_t point_step = 1;
  /// The plane of each point is looked up again once the pose has moved by more than this share of
  /// a patch's radius since the last time: its rotation plus its translation over the median range.
  /// Closer points move further, and up to about this share of all points is seen by a neighbour's
  /// plane. A registration converges only right after looking up, so where it ends does not depend
  /// on it. 0: look up in every iteration.
  double reuse_share = 0.05;
  /// Fewer points than this within the gate of an iteration: the registration fails.
  std::size_t min_points_in_gate = 100;
  /// A motion whose `weakest_share` is below this is degenerate, and its information is taken for
  /// the noise of the normals that it mostly is: it counts a millionth. A corridor without ends
  /// measures 0.028 at 1 cm of range noise, dense scans of KITTI 00 0.1 to 0.18, scans thinned to
  /// 6,000 points 0.02 to 0.2.
  double degeneracy_share = 0.03;
  /// What residuals cannot show, added to the covariance as independent deviations about the scan's
  /// origin: a CELL whose scans were stacked a little off pulls every point the same way. Measured
  /// as half the disagreement between the two directions of neighbouring CELLs of KITTI 00.
  double systematic_translation_m = 0.02;
  double systematic_rotation_deg = 0.05;
  /// Whether the result is judged: scores, rmse, information and degeneracy, which together cost
  /// about as much as two iterations on all points. Without it they stay empty, and
  /// `is_acceptable` refuses the result.
  bool judge = true;
  /// 0: all. The result does not depend on it: points are summed in fixed chunks.
  int threads = 1;
  /// Called at least every 8,192 points of an iteration, and by what registers often in between.
  GiveWay give_way;

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
  Effort effort() const { return {threads, give_way}; }
};

/// How well points agree with the CELL's planes at a pose. "Hit" points are
/// those whose direction has a plane. All shares are in [0, 1].
struct RegistrationScores {
  std::uint32_t points = 0;
  std::uint32_t hits = 0;
  double inlier_ratio_all = 0;  ///< within 0.2 m of the plane, over all points (the paper's)
  double inlier_ratio_hit = 0;  ///< within 0.2 m of the plane, over hit points
  double share_in_front =
      0;  ///< of hit points: more than 1 m nearer than the plane, along the normal
  double share_beyond = 0;  ///< of hit points: more than 1 m behind the plane, along the normal
  /// Median absolute point-to-plane distance of hit points, of about 16,000 evenly spaced ones
  /// where there are more.
  double median_residual_m = 0;
};

/// Which motion the geometry does not hold, from the eigenvalues of the residuals' information
/// (without the systematic part).
struct Degeneracy {
  bool degenerate = false;            ///< a direction is weaker than the threshold
  Tangent weakest = Tangent::Zero();  ///< unit vector, target frame, at the scan's origin
  double weakest_share = 0;  ///< its eigenvalue over the largest of its kind (translation or
                             ///< rotation scaled by the median range), in [0, 1]
};

/// The outcome of a registration. Not converged is a value, and never becomes a constraint.
struct RegistrationResult {
  Pose T_target_source = Pose::Identity();
  bool converged = false;
  int iterations = 0;
  RegistrationScores
      scores;         ///< at the final pose; for bidirectional registration over both directions
  double rmse_m = 0;  ///< of the inliers
  /// Inverse covariance of the left perturbation exp(xi) * T_target_source, order (translation,
  /// rotation): Gauss-Newton information of the inliers, scaled by the variance of the residuals
  /// and by how few of them are independent (information.hpp), limited by the systematic deviations
  /// of the options. Motions that nothing holds have an eigenvalue near zero.
  Matrix6d information = Matrix6d::Zero();
  Degeneracy degeneracy;
};

/// Scan-to-CELL registration (paper, Sec. III-C): each point's direction, moved by the current
/// estimate, is looked up in the lattice; point-to-plane Gauss-Newton with left perturbation;
/// correspondences are renewed in every iteration. `scan` in its sensor frame.
RegistrationResult register_scan(const RegistrationTarget& target, const PointCloud& scan,
                                 const Pose& T_cell_scan_initial,
                                 const RegistrationOptions& options = {});

/// Bidirectional registration of two CELLs with their base scans (paper, Sec. III-C, end): both
/// directions in one normal system, correspondences of both renewed from the current estimate.
/// `scan_a` in the frame of CELL a, `scan_b` in the frame of CELL b. The result is T_a_b.
RegistrationResult register_cells(const RegistrationTarget& a, const PointCloud& scan_a,
                                  const RegistrationTarget& b, const PointCloud& scan_b,
                                  const Pose& T_a_b_initial,
                                  const RegistrationOptions& options = {});

/// The scores of a scan at a given pose, without registering it.
RegistrationScores score_scan(const RegistrationTarget& target, const PointCloud& scan,
                              const Pose& T_cell_scan, std::size_t point_step = 1);

/// When a registered pose is believed: several scores must agree, because each alone has thin
/// margins. Measured on KITTI 00 with one registered scan against one CELL:
///
/// | | right place | wrong place that converged |
/// | dense (120k points, N = 50,000), inliers over hits | 0.86 to 0.99 | up to 0.72 |
/// | dense, share in front | below 0.005 | from 0.04 |
/// | dense, median residual | up to 0.03 m | from 0.04 m |
/// | thinned to 6k points, N = 20,000, inliers over hits | 0.67 to 0.94, median 0.86 | up to 0.62 |
/// | thinned, share in front | up to 0.03 | from 0.05 |
///
/// For scans as sparse as that a lattice of 20,000 and min_inlier_ratio_hit = 0.65 serve better.
struct AcceptanceOptions {
  double min_inlier_ratio_hit = 0.75;
  double max_share_in_front = 0.03;
  double max_median_residual_m = 0.12;
  double min_hit_share = 0.1;         ///< hits over points
  double min_inlier_ratio_all = 0.0;  ///< the paper's test is 0.2 here and nothing else

  void validate() const;
};

/// True where the result converged and passes every test.
bool is_acceptable(const RegistrationResult& result, const AcceptanceOptions& options);

}  // namespace cellmap
