#include "cellmap/registration/information.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "cellmap/registration/scores.hpp"

namespace cellmap {
namespace {

/// No plane and no point is trusted to be better than this, whatever the distances say.
constexpr double kLeastDeviationM = 1e-3;

/// What is left of the information about a degenerate motion.
constexpr double kShareOfDegenerate = 1e-6;

double largest_eigenvalue(const Eigen::Matrix3d& A) {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(A).eigenvalues()[2];
}

struct PlaneMoments {
  double count = 0, sum = 0, sum_of_squares = 0;
};

std::vector<PlaneMoments> inlier_moments(const HitDistances& hits, std::size_t planes) {
  std::vector<PlaneMoments> moments(planes);
  for (std::size_t i = 0; i < hits.plane.size(); ++i) {
    const double distance = hits.distance_m[i];
    if (std::abs(distance) > kInlierDistanceM) continue;
    PlaneMoments& plane = moments[hits.plane[i]];
    plane.count += 1;
    plane.sum += distance;
    plane.sum_of_squares += distance * distance;
  }
  return moments;
}

struct VarianceComponents {
  double of_plane, of_point;  // b and w, m^2
};

/// One-way random-effects analysis of variance with mean zero: E[within] = (n - P) w and
/// E[between] = P w + n b for n points on P planes.
VarianceComponents variance_components(std::span<const std::vector<PlaneMoments>> terms) {
  double n = 0, planes = 0, within = 0, between = 0;
  for (const std::vector<PlaneMoments>& moments : terms) {
    for (const PlaneMoments& plane : moments) {
      if (plane.count == 0) continue;
      const double of_mean = plane.sum * plane.sum / plane.count;
      n += plane.count;
      planes += 1;
      within += plane.sum_of_squares - of_mean;
      between += of_mean;
    }
  }
  const double floor = kLeastDeviationM * kLeastDeviationM;
  const double w = n > planes ? std::max(within / (n - planes), floor) : floor;
  const double b = n > 0 ? std::max((between - planes * w) / n, floor) : floor;
  return {b, w};
}

/// A motion about the target's origin from the same motion about the scan's: rho = rho' + t x phi.
Matrix6d about_scan_origin(const Pose& T) {
  Matrix6d A = Matrix6d::Identity();
  A.topRightCorner<3, 3>() = skew(T.translation());
  return A;
}

}  // namespace

Matrix6d information_of(std::span<MatchedTerm> terms, std::span<const HitDistances> hits,
                        const Pose& T) {
  std::vector<std::vector<PlaneMoments>> moments;
  for (std::size_t i = 0; i < terms.size(); ++i) {
    moments.push_back(inlier_moments(hits[i], terms[i].term().target->cell().planes.size()));
  }
  const VarianceComponents variance = variance_components(moments);
  NormalSystem system;
  for (std::size_t i = 0; i < terms.size(); ++i) {
    std::vector<double> weight;
    weight.reserve(moments[i].size());
    for (const PlaneMoments& plane : moments[i]) {
      weight.push_back(1.0 / (plane.count * variance.of_plane + variance.of_point));
    }
    terms[i].add_plane_weighted(T, kInlierDistanceM, weight, system);
  }
  return system.H / kPlanesAWitness;
}

Matrix6d with_systematic_deviation(const Matrix6d& information, const Pose& T,
                                   const RegistrationOptions& options) {
  if (options.systematic_translation_m == 0) return information;
  const double translation = 1.0 / options.systematic_translation_m;
  const double rotation = 180.0 / std::numbers::pi / options.systematic_rotation_deg;
  Tangent precision;
  precision << Eigen::Vector3d::Constant(translation * translation),
      Eigen::Vector3d::Constant(rotation * rotation);
  const Matrix6d to_scan = about_scan_origin(T).inverse();
  const Matrix6d limit = to_scan.transpose() * precision.asDiagonal() * to_scan;
  // (H^-1 + L^-1)^-1 = H (H + L)^-1 L.
  const Matrix6d sum = information * (information + limit).ldlt().solve(limit);
  return 0.5 * (sum + sum.transpose());
}

double median_range_m(std::span<const RegistrationTerm> terms) {
  constexpr std::size_t kRanges = 1'000;
  std::vector<float> ranges;
  for (const RegistrationTerm& term : terms) {
    const std::size_t step = std::max<std::size_t>(1, term.scan->size() / kRanges);
    for (std::size_t i = 0; i < term.scan->size(); i += step) {
      ranges.push_back((*term.scan)[i].norm());
    }
  }
  if (ranges.empty()) return 0;
  const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
  std::nth_element(ranges.begin(), middle, ranges.end());
  return *middle;
}

HeldMotions held_motions(const Matrix6d& information, const Pose& T, double median_range_m,
                         double degeneracy_share) {
  HeldMotions held;
  held.degeneracy.degenerate = true;
  if (!(median_range_m > 0) || !(information.trace() > 0)) return held;
  // A rotation in units of 1 / median range moves a typical point by about one unit, as a
  // translation does.
  Matrix6d A = about_scan_origin(T);
  A.rightCols<3>() /= median_range_m;
  const Matrix6d at_scan = A.transpose() * information * A;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> motions(at_scan);
  const double strongest_translation = largest_eigenvalue(at_scan.topLeftCorner<3, 3>());
  const double strongest_rotation = largest_eigenvalue(at_scan.bottomRightCorner<3, 3>());

  Tangent kept = motions.eigenvalues().cwiseMax(0.0);
  for (int k = 5; k >= 0; --k) {  // the weakest last
    const Tangent motion = motions.eigenvectors().col(k);
    const double strongest =
        motion.head<3>().squaredNorm() >= 0.5 ? strongest_translation : strongest_rotation;
    held.degeneracy.weakest_share = strongest > 0 ? std::clamp(kept[k] / strongest, 0.0, 1.0) : 0.0;
    held.degeneracy.degenerate = held.degeneracy.weakest_share < degeneracy_share;
    if (held.degeneracy.degenerate) kept[k] *= kShareOfDegenerate;
    held.degeneracy.weakest = motion;
  }
  held.degeneracy.weakest.tail<3>() /= median_range_m;
  held.degeneracy.weakest.normalize();
  const Matrix6d from_target = motions.eigenvectors().transpose() * A.inverse();
  held.information = from_target.transpose() * kept.asDiagonal() * from_target;
  return held;
}

}  // namespace cellmap
