#include "cellmap/place/structure_score.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/registration/residuals.hpp"

namespace cellmap {
namespace {

constexpr double kLevelNormalZ = 0.7;  // cos 45 deg
constexpr double kOffLevelM = 0.5;
/// Less structure than this proves nothing.
constexpr std::uint32_t kFewestPlanes = 50, kFewestStructurePoints = 50;
constexpr double kInlierM = 0.2, kBlockedM = 1.0;  // as in RegistrationScores

/// Wide enough that a thinned scan has points in the directions it covers.
constexpr std::uint32_t kScanLatticeSize = 8'000;

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

bool is_level(const Plane& plane) { return std::abs(plane.nz) >= kLevelNormalZ; }

void score_forward(const RegistrationTarget& target, const PointCloud& scan,
                   const Pose& T_cell_scan, StructureScores& scores) {
  const HitDistances hits = MatchedTerm({&target, &scan, false}, 1).distances(T_cell_scan);
  std::size_t points = 0, inliers = 0, in_front = 0;
  for (std::size_t i = 0; i < hits.plane.size(); ++i) {
    const double distance = hits.distance_m[i];
    if (is_level(target.cell().planes[hits.plane[i]]) && std::abs(distance) <= kOffLevelM) continue;
    ++points;
    inliers += std::abs(distance) <= kInlierM;
    in_front += distance > kBlockedM;
  }
  scores.points = static_cast<std::uint32_t>(points);
  scores.inlier_ratio = share(inliers, points);
  scores.share_in_front = share(in_front, points);
}

std::vector<std::uint32_t> nearest_of(const Lattice& lattice, const PointCloud& points) {
  std::vector<std::uint32_t> indices(points.size());
  lattice.nearest(points, indices);
  return indices;
}

/// The points of a scan by direction, sorted by counting.
class DirectionImage {
 public:
  DirectionImage(const Lattice& lattice, const PointCloud& scan) : begin_(lattice.size() + 2, 0) {
    std::vector<std::uint32_t> patch = nearest_of(lattice, scan);
    // Sensors mark missing returns with the origin, which has no direction.
    for (std::uint32_t& i : patch) i = std::min(i, lattice.size());
    for (const std::uint32_t i : patch) ++begin_[i + 1];
    for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
    std::vector<std::uint32_t> next = begin_;
    points_.resize(scan.size());
    for (std::size_t i = 0; i < scan.size(); ++i) {
      points_[next[patch[i]]++] = {scan[i], scan[i].norm()};
    }
  }

  struct Point {
    Eigen::Vector3f position;
    float range_m;
  };
  std::span<const Point> along(std::uint32_t patch) const {
    return std::span(points_).subspan(begin_[patch], begin_[patch + 1] - begin_[patch]);
  }

 private:
  std::vector<std::uint32_t> begin_;
  std::vector<Point> points_;
};

/// What a scan says of one plane of the CELL.
struct PlaneSeen {
  bool confirmed = false, tight = false, hidden = true, seen_through = true;

  PlaneSeen(std::span<const DirectionImage::Point> points, const Eigen::Vector3f& at,
            const Eigen::Vector3f& normal) {
    constexpr float kTightM = 0.1f;
    const float range = at.norm();
    const float tolerance = std::max(0.5f, 0.05f * range);
    const float through = range + std::max(static_cast<float>(kBlockedM), 0.1f * range);
    for (const DirectionImage::Point& p : points) {
      const bool agrees = std::abs(p.range_m - range) <= tolerance;
      confirmed |= agrees;
      tight |= agrees && std::abs(normal.dot(p.position - at)) <= kTightM;
      hidden &= p.range_m < range - tolerance;
      seen_through &= p.range_m > through;
    }
  }
};

/// Where the planes of a CELL that are not level meet their rays, and their normals, in the frame
/// of a scan.
UprightSurfaces upright_structure(const RegistrationTarget& target, const Pose& T_scan_cell) {
  UprightSurfaces structure;
  const Cell& cell = target.cell();
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    const Plane& plane = cell.planes[k];
    if (is_level(plane)) continue;
    const Eigen::Vector3d p = T_scan_cell * (static_cast<double>(plane.distance_m) *
                                             target.lattice().direction(cell.indices[k]));
    const Eigen::Vector3d n = T_scan_cell.linear() * Eigen::Vector3d(plane.nx, plane.ny, plane.nz);
    structure.points.push_back(p.cast<float>());
    structure.normals.push_back(n.cast<float>());
  }
  return structure;
}

void score_reverse(const RegistrationTarget& target, const PointCloud& scan,
                   const Pose& T_cell_scan, StructureScores& scores) {
  constexpr std::size_t kFewestPoints = 2;
  const Lattice lattice({LatticeKind::kFibonacci, kScanLatticeSize});
  const DirectionImage image(lattice, scan);
  const UprightSurfaces structure = upright_structure(target, T_cell_scan.inverse());
  const std::vector<std::uint32_t> patch = nearest_of(lattice, structure.points);
  std::size_t planes = 0, confirmed = 0, tight = 0, seen_through = 0, visible = 0;
  for (std::size_t k = 0; k < patch.size(); ++k) {
    if (patch[k] == Lattice::kNowhere) continue;
    const auto points = image.along(patch[k]);
    if (points.size() < kFewestPoints) continue;
    const PlaneSeen seen(points, structure.points[k], structure.normals[k]);
    ++planes;
    confirmed += seen.confirmed;
    tight += seen.tight;
    visible += !seen.hidden;
    seen_through += seen.seen_through;
  }
  scores.planes = static_cast<std::uint32_t>(planes);
  scores.confirmed_ratio = share(confirmed, planes);
  scores.tight_ratio = share(tight, planes);
  scores.visible_tight_ratio = share(tight, visible);
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

double confidence_of(const StructureScores& scores, double weakest_share) {
  constexpr double kHeldWell = 0.06, kNotHeld = 1e-3;
  if (scores.planes < kFewestPlanes || scores.points < kFewestStructurePoints) return 0.0;
  const double held = std::log(std::clamp(weakest_share, kNotHeld, kHeldWell));
  const double logit =
      29.24 * scores.tight_ratio + 0.61 * scores.visible_tight_ratio + 5.74 * held + 2.77;
  return 1 / (1 + std::exp(-logit));
}

AcceptanceOptions searched_place_acceptance() {
  AcceptanceOptions options;
  options.min_inlier_ratio_hit = 0.5;
  options.max_share_in_front = 0.3;
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
