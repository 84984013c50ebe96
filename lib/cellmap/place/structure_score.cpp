#include "cellmap/place/structure_score.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "cellmap/registration/residuals.hpp"

namespace cellmap {
namespace {

constexpr double kLevelNormalZ = 0.7;  // cos 45 deg
constexpr double kOffLevelM = 0.5;
/// Less structure than this proves nothing.
constexpr std::uint32_t kFewestPlanes = 50, kFewestStructurePoints = 50;
/// What the CELLs around add to the odds, and where they add nothing: midway between right poses
/// and wrong ones.
constexpr double kOddsOfAround = 30, kEvenAround = 0.68, kEvenAroundNarrow = 0.9;
constexpr std::uint32_t kFewestParts = 12;
constexpr double kInlierM = 0.2, kBlockedM = 1.0;  // as in RegistrationScores

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

bool is_level(const Plane& plane) { return std::abs(plane.nz) >= kLevelNormalZ; }

void score_forward(const RegistrationTarget& target, const PointCloud& scan,
                   const Pose& T_cell_scan, StructureScores& scores) {
  const StructurePoints seen = structure_points(target, scan, T_cell_scan);
  scores.points = seen.points;
  scores.inlier_ratio = share(seen.inliers, seen.points);
  scores.share_in_front = share(seen.in_front, seen.points);
}

std::vector<std::uint32_t> nearest_of(const Lattice& lattice, const PointCloud& points) {
  std::vector<std::uint32_t> indices(points.size());
  lattice.nearest(points, indices);
  return indices;
}

void score_reverse(const RegistrationTarget& target, const ScanView& scan, const Pose& T_cell_scan,
                   StructureScores& scores) {
  std::size_t planes = 0, confirmed = 0, tight = 0, seen_through = 0, visible = 0;
  look_at_upright_planes(target, scan, T_cell_scan, 1, [&](const Eigen::Vector3f&, PlaneSeen seen) {
    ++planes;
    confirmed += seen.confirmed;
    tight += seen.tight;
    visible += !seen.hidden;
    seen_through += seen.seen_through;
  });
  scores.planes = static_cast<std::uint32_t>(planes);
  scores.confirmed_ratio = share(confirmed, planes);
  scores.tight_ratio = share(tight, planes);
  scores.visible_tight_ratio = share(tight, visible);
  scores.share_seen_through = share(seen_through, planes);
}

/// Natural logarithm of the odds that a pose is right, by one CELL.
double log_odds(const StructureScores& scores, double weakest_share) {
  constexpr double kHeldWell = 0.06, kNotHeld = 1e-3, kNever = -100;
  if (scores.planes < kFewestPlanes || scores.points < kFewestStructurePoints) return kNever;
  const double held = std::log(std::clamp(weakest_share, kNotHeld, kHeldWell));
  return 29.24 * scores.tight_ratio + 0.61 * scores.visible_tight_ratio + 5.74 * held + 2.77;
}

double probability(double log_odds) { return 1 / (1 + std::exp(-log_odds)); }

}  // namespace

StructurePoints structure_points(const RegistrationTarget& target, const PointCloud& scan,
                                 const Pose& T_cell_scan) {
  const HitDistances hits = MatchedTerm({&target, &scan, false}, 1).distances(T_cell_scan);
  StructurePoints seen;
  for (std::size_t i = 0; i < hits.plane.size(); ++i) {
    const double distance = hits.distance_m[i];
    if (is_level(target.cell().planes[hits.plane[i]]) && std::abs(distance) <= kOffLevelM) continue;
    ++seen.points;
    seen.inliers += std::abs(distance) <= kInlierM;
    seen.in_front += distance > kBlockedM;
  }
  return seen;
}

void look_at_upright_planes(
    const RegistrationTarget& target, const ScanView& scan, const Pose& T_cell_scan,
    std::size_t step, const std::function<void(const Eigen::Vector3f&, const PlaneSeen&)>& visit) {
  constexpr std::size_t kFewestPoints = 2;
  const Cell& cell = target.cell();
  const Pose T_scan_cell = T_cell_scan.inverse();
  PointCloud at;
  std::vector<Eigen::Vector3f> normals;
  for (std::size_t k = 0; k < cell.planes.size(); k += step) {
    const Plane& plane = cell.planes[k];
    if (is_level(plane)) continue;
    const Eigen::Vector3d p = T_scan_cell * (static_cast<double>(plane.distance_m) *
                                             target.lattice().direction(cell.indices[k]));
    const Eigen::Vector3d n = T_scan_cell.linear() * Eigen::Vector3d(plane.nx, plane.ny, plane.nz);
    at.push_back(p.cast<float>());
    normals.push_back(n.cast<float>());
  }
  const std::vector<std::uint32_t> patch = scan.patches_of(at);
  for (std::size_t k = 0; k < patch.size(); ++k) {
    if (patch[k] == Lattice::kNowhere) continue;
    const auto points = scan.along(patch[k]);
    if (points.size() >= kFewestPoints) visit(at[k], PlaneSeen(points, at[k], normals[k]));
  }
}

double quick_tight_ratio(const RegistrationTarget& target, const ScanView& scan,
                         const Pose& T_cell_scan) {
  constexpr std::size_t kEveryThird = 3;
  std::size_t planes = 0, tight = 0;
  look_at_upright_planes(target, scan, T_cell_scan, kEveryThird,
                         [&](const Eigen::Vector3f&, const PlaneSeen& seen) {
                           ++planes;
                           tight += seen.tight;
                         });
  return kEveryThird * planes < kFewestPlanes ? 0.0 : share(tight, planes);
}

StructureScores score_structure(const RegistrationTarget& target, const PointCloud& scan,
                                const Pose& T_cell_scan) {
  return score_structure(target, ScanView(scan), T_cell_scan);
}

StructureScores score_structure(const RegistrationTarget& target, const ScanView& scan,
                                const Pose& T_cell_scan) {
  StructureScores scores;
  score_forward(target, scan.points(), T_cell_scan, scores);
  score_reverse(target, scan, T_cell_scan, scores);
  return scores;
}

void score_facing(const RegistrationTarget& target, const UprightSurfaces& surfaces,
                  const Pose& T_cell_scan, StructureScores& scores) {
  constexpr double kNearM = 0.3, kSameWay = 0.906;  // cos 25 deg
  const PointCloud points = transformed(surfaces.points, T_cell_scan);
  const std::vector<std::uint32_t> patch = nearest_of(target.lattice(), points);
  std::size_t met = 0, facing = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::uint32_t slot = patch[i] == Lattice::kNowhere ? 0 : target.slot_of(patch[i]);
    if (slot == 0) continue;
    ++met;
    const Plane& plane = target.cell().planes[slot - 1];
    const Eigen::Vector3d n(plane.nx, plane.ny, plane.nz);
    const Eigen::Vector3d on_plane = plane.distance_m * target.lattice().direction(patch[i]);
    const Eigen::Vector3d facing_to = T_cell_scan.linear() * surfaces.normals[i].cast<double>();
    facing += std::abs(n.dot(points[i].cast<double>() - on_plane)) <= kNearM &&
              std::abs(n.dot(facing_to)) >= kSameWay;
  }
  scores.surfaces = static_cast<std::uint32_t>(met);
  scores.facing_ratio = share(facing, met);
}

double agreement(const StructureScores& scores) {
  return std::min(scores.inlier_ratio, scores.confirmed_ratio);
}

bool is_acceptable(const StructureScores& scores, const StructureAcceptance& options) {
  return scores.points >= options.min_points && scores.inlier_ratio >= options.min_inlier_ratio &&
         scores.share_in_front <= options.max_share_in_front &&
         scores.confirmed_ratio >= options.min_confirmed_ratio &&
         scores.share_seen_through <= options.max_share_seen_through;
}

double confidence_of(const StructureScores& scores, double weakest_share) {
  return probability(log_odds(scores, weakest_share));
}

double confidence_of(const StructureScores& scores, const SurroundingsScores& surroundings,
                     double weakest_share) {
  const double own = log_odds(scores, weakest_share);
  if (surroundings.cells < kFewestAround) return probability(own);
  // A narrow view may show one wall to many CELLs: little that agrees is no more than no doubt.
  const double around =
      surroundings.parts < kFewestParts
          ? std::min(0.0, kOddsOfAround * (agreement(surroundings) - kEvenAroundNarrow))
          : kOddsOfAround * (agreement(surroundings) - kEvenAround);
  return probability(own + around);
}

double odds_against(const SurroundingsScores& pose, const SurroundingsScores& other) {
  if (other.cells < kFewestAround) return 0.0;
  return std::exp(kOddsOfAround * (agreement(other) - agreement(pose)));
}

}  // namespace cellmap
