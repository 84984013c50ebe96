#include "cellmap/place/structure_score.hpp"

#include <cmath>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr double kLevelNormalZ = 0.7;  // cos 45 deg
constexpr double kOffLevelM = 0.5;
constexpr double kInlierM = 0.2, kBlockedM = 1.0;  // as in RegistrationScores

}  // namespace

StructureScores score_structure(const RegistrationTarget& target, const PointCloud& scan,
                                const Pose& T_cell_scan) {
  std::size_t points = 0, inliers = 0, in_front = 0;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const Eigen::Vector3d p = T_cell_scan * scan[i].cast<double>();
    if (!(p.squaredNorm() > 0)) continue;
    const std::int32_t k = target.plane_of(target.lattice().nearest(p));
    if (k < 0) continue;
    const Plane& plane = target.cell().planes[static_cast<std::size_t>(k)];
    const double distance = plane.nx * p.x() + plane.ny * p.y() + plane.nz * p.z() -
                            target.offset(static_cast<std::size_t>(k));
    if (std::abs(plane.nz) >= kLevelNormalZ && std::abs(distance) <= kOffLevelM) continue;
    ++points;
    inliers += std::abs(distance) <= kInlierM;
    in_front += distance > kBlockedM;
  }
  StructureScores scores;
  scores.points = static_cast<std::uint32_t>(points);
  if (points == 0) return scores;
  scores.inlier_ratio = static_cast<double>(inliers) / static_cast<double>(points);
  scores.share_in_front = static_cast<double>(in_front) / static_cast<double>(points);
  return scores;
}

void StructureAcceptance::validate() const {
  const auto is_share = [](double value) { return value >= 0 && value <= 1; };
  if (is_share(min_inlier_ratio) && is_share(max_share_in_front)) return;
  throw Error(
      ErrorCode::kInvalidArgument,
      "structure acceptance: min_inlier_ratio and max_share_in_front must be within 0 and 1");
}

bool is_acceptable(const StructureScores& scores, const StructureAcceptance& options) {
  return scores.points >= options.min_points && scores.inlier_ratio >= options.min_inlier_ratio &&
         scores.share_in_front <= options.max_share_in_front;
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
