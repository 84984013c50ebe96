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

/// The ranges of a scan by direction, sorted by counting.
class RangeImage {
 public:
  RangeImage(const Lattice& lattice, const PointCloud& scan) : begin_(lattice.size() + 2, 0) {
    std::vector<std::uint32_t> patch = nearest_of(lattice, scan);
    // Sensors mark missing returns with the origin, which has no direction.
    for (std::uint32_t& i : patch) i = std::min(i, lattice.size());
    for (const std::uint32_t i : patch) ++begin_[i + 1];
    for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1];
    std::vector<std::uint32_t> next = begin_;
    ranges_.resize(scan.size());
    for (std::size_t i = 0; i < scan.size(); ++i) ranges_[next[patch[i]]++] = scan[i].norm();
  }

  std::span<const float> along(std::uint32_t patch) const {
    return std::span(ranges_).subspan(begin_[patch], begin_[patch + 1] - begin_[patch]);
  }

 private:
  std::vector<std::uint32_t> begin_;
  std::vector<float> ranges_;
};

/// Where the planes of a CELL that are not level meet their rays, in the frame of a scan.
PointCloud upright_structure(const RegistrationTarget& target, const Pose& T_scan_cell) {
  PointCloud points;
  const Cell& cell = target.cell();
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    if (is_level(cell.planes[k])) continue;
    const Eigen::Vector3d p = T_scan_cell * (static_cast<double>(cell.planes[k].distance_m) *
                                             target.lattice().direction(cell.indices[k]));
    points.push_back(p.cast<float>());
  }
  return points;
}

void score_reverse(const RegistrationTarget& target, const PointCloud& scan,
                   const Pose& T_cell_scan, StructureScores& scores) {
  constexpr std::size_t kFewestRanges = 2;
  const Lattice lattice({LatticeKind::kFibonacci, kScanLatticeSize});
  const RangeImage image(lattice, scan);
  const PointCloud points = upright_structure(target, T_cell_scan.inverse());
  const std::vector<std::uint32_t> patch = nearest_of(lattice, points);
  std::size_t planes = 0, confirmed = 0, seen_through = 0;
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (patch[k] == Lattice::kNowhere) continue;
    const double range = points[k].norm();
    const std::span<const float> seen = image.along(patch[k]);
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
