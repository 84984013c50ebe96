#include "cellmap/place/pose_search.hpp"

#include <algorithm>

namespace cellmap {
namespace {

constexpr double kSameSpotM = 0.3, kSameHeadingRad = 0.03;

/// Wide gates first, because starts are metres away; a wider kernel than the final one, because few
/// points are noisier.
RegistrationOptions search_registration(const RegistrationOptions& final_options) {
  RegistrationOptions options = final_options;
  options.stages = {{6, 3.0, RobustKernel::kCauchy, 0.5},
                    {4, 1.0, RobustKernel::kNone, 0.05},
                    {6, 0.5, RobustKernel::kGemanMcClure, 0.1}};
  options.min_points_in_gate = std::min<std::size_t>(options.min_points_in_gate, 50);
  options.threads = 1;
  return options;
}

bool same_pose(const Pose& a, const Pose& b) {
  return (a.translation() - b.translation()).norm() < kSameSpotM &&
         angle_between_rad(a, b) < kSameHeadingRad;
}

}  // namespace

double agreement(const RegistrationScores& scores) {
  if (scores.points == 0 || scores.hits == 0) return -1.0;
  const double hit_share = static_cast<double>(scores.hits) / scores.points;
  return scores.inlier_ratio_hit * std::min(1.0, hit_share / 0.3) - scores.share_in_front;
}

std::vector<RegistrationResult> search_poses(const RegistrationTarget& target,
                                             const PointCloud& scan, std::span<const Pose> starts,
                                             const PoseSearchOptions& options) {
  const PointCloud few = thinned(scan, options.search_points);
  const RegistrationOptions registration = search_registration(options.registration);
  std::vector<RegistrationResult> found;
  for (const Pose& start : starts) {
    RegistrationResult result = register_scan(target, few, start, registration);
    const auto known = std::find_if(found.begin(), found.end(), [&](const RegistrationResult& r) {
      return same_pose(r.T_target_source, result.T_target_source);
    });
    if (known == found.end()) {
      found.push_back(std::move(result));
    } else if (agreement(result.scores) > agreement(known->scores)) {
      *known = std::move(result);
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const RegistrationResult& a, const RegistrationResult& b) {
                     return agreement(a.scores) > agreement(b.scores);
                   });
  return found;
}

RegistrationResult refine_pose(const RegistrationTarget& target, const PointCloud& scan,
                               const Pose& start, const PoseSearchOptions& options) {
  return register_scan(target, thinned(scan, options.refine_points), start, options.registration);
}

PointCloud thinned(const PointCloud& scan, std::size_t count) {
  return every_nth(scan, std::max<std::size_t>(1, scan.size() / std::max<std::size_t>(1, count)));
}

}  // namespace cellmap
