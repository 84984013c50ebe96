#include "cellmap/place/structure_score.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr double kLevelNormalZ = 0.7;  // cos 45 deg
constexpr double kOffLevelM = 0.5;
constexpr double kInlierM = 0.2, kBlockedM = 1.0;  // as in RegistrationScores

/// Wide enough that a thinned scan has points in the directions it covers.
constexpr std::uint32_t kScanLatticeSize = 8'000;

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

bool is_level(const Plane& plane) { return std::abs(plane.nz) >= kLevelNormalZ; }

void score_forward(const RegistrationTarget& target, const PointCloud& scan,
                   const Pose& T_cell_scan, StructureScores& scores) {
  std::size_t points = 0, inliers = 0, in_front = 0;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Eigen::Vector3d p = T_cell_scan * scan[i].cast<double>();
    if (!(p.squaredNorm() > 0)) continue;
    const std::int32_t k = target.plane_of(target.lattice().nearest(p));
    if (k < 0) continue;
    const Plane& plane = target.cell().planes[static_cast<std::size_t>(k)];
    const double distance = plane.nx * p.x() + plane.ny * p.y() + plane.nz * p.z() -
                            target.offset(static_cast<std::size_t>(k));
    if (is_level(plane) && std::abs(distance) <= kOffLevelM) continue;
    ++points;
    inliers += std::abs(distance) <= kInlierM;
    in_front += distance > kBlockedM;
  }
  scores.points = static_cast<std::uint32_t>(points);
  scores.inlier_ratio = share(inliers, points);
  scores.share_in_front = share(in_front, points);
}

/// The ranges of a scan by direction.
class RangeImage {
 public:
  explicit RangeImage(const PointCloud& scan)
      : lattice_({LatticeKind::kFibonacci, kScanLatticeSize}), ranges_(kScanLatticeSize) {
    for (std::size_t i = 0; i < scan.size(); ++i) {
      const Eigen::Vector3d p = scan[i].cast<double>();
      // Sensors mark missing returns with the origin, which has no direction.
      if (p.squaredNorm() > 0) ranges_[lattice_.nearest(p)].push_back(static_cast<float>(p.norm()));
    }
  }

  const std::vector<float>& along(const Eigen::Vector3d& direction) const {
    return ranges_[lattice_.nearest(direction)];
  }

 private:
  Lattice lattice_;
  std::vector<std::vector<float>> ranges_;
};

void score_reverse(const RegistrationTarget& target, const PointCloud& scan,
                   const Pose& T_cell_scan, StructureScores& scores) {
  constexpr std::size_t kFewestRanges = 2;
  const RangeImage image(scan);
  const Pose T_scan_cell = T_cell_scan.inverse();
  const Cell& cell = target.cell();
  std::size_t planes = 0, confirmed = 0, seen_through = 0;
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    if (is_level(cell.planes[k])) continue;
    const Eigen::Vector3d p = T_scan_cell * (static_cast<double>(cell.planes[k].distance_m) *
                                             target.lattice().direction(cell.indices[k]));
    const double range = p.norm();
    if (!(range > 0)) continue;
    const std::vector<float>& seen = image.along(p);
    if (seen.size() < kFewestRanges) continue;
    ++planes;
    const double tolerance = std::max(0.5, 0.05 * range);
    confirmed += std::any_of(seen.begin(), seen.end(),
                             [&](float r) { return std::abs(r - range) <= tolerance; });
    const double nearest = *std::min_element(seen.begin(), seen.end());
    seen_through += nearest > range + std::max(kBlockedM, 0.1 * range);
  }
  scores.planes = static_cast<std::uint32_t>(planes);
  scores.confirmed_ratio = share(confirmed, planes);
  scores.share_seen_through = share(seen_through, planes);
}

}  // namespace

StructureScores score_structure(const RegistrationTarget& target, const PointCloud& scan,
                                const Pose& T_cell_scan) {
  StructureScores scores;
  score_forward(target, scan, T_cell_scan, scores);
  score_reverse(target, scan, T_cell_scan, scores);
  return scores;
}

double agreement(const StructureScores& scores) {
  return std::min(scores.inlier_ratio, scores.confirmed_ratio);
}

void StructureAcceptance::validate() const {
  const auto is_share = [](double value) { return value >= 0 && value <= 1; };
  if (is_share(min_inlier_ratio) && is_share(max_share_in_front) && is_share(min_confirmed_ratio) &&
      is_share(max_share_seen_through)) {
    return;
  }
  throw Error(ErrorCode::kInvalidArgument,
              "structure acceptance: its ratios and shares must be within 0 and 1");
}

bool is_acceptable(const StructureScores& scores, const StructureAcceptance& options) {
  return scores.points >= options.min_points && scores.inlier_ratio >= options.min_inlier_ratio &&
         scores.share_in_front <= options.max_share_in_front &&
         scores.confirmed_ratio >= options.min_confirmed_ratio &&
         scores.share_seen_through <= options.max_share_seen_through;
}

StructureAcceptance clear_structure_acceptance() {
  return {.min_inlier_ratio = 0.5,
          .max_share_in_front = 0.045,
          .min_confirmed_ratio = 0.7,
          .max_share_seen_through = 0.075};
}

StructureAcceptance busy_structure_acceptance() {
  return {.min_inlier_ratio = 0.45,
          .max_share_in_front = 0.25,
          .min_confirmed_ratio = 0.55,
          .max_share_seen_through = 0.3};
}

AcceptanceOptions busy_place_acceptance() {
  AcceptanceOptions options;
  options.max_share_in_front = 0.08;
  options.max_median_residual_m = 0.06;
  return options;
}

AcceptanceOptions default_place_acceptance() {
  AcceptanceOptions options;
  options.max_share_in_front = 0.02;
  return options;
}

RegistrationOptions default_place_registration() {
  RegistrationOptions options;
  options.convergence_translation_m = 1e-3;
  options.convergence_rotation_rad = 1e-4;
  return options;
}

}  // namespace cellmap
