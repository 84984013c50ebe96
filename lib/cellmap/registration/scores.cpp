#include "cellmap/registration/scores.hpp"

#include <algorithm>
#include <cmath>

namespace cellmap {
namespace {

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
}

double median_residual_m(std::span<const HitDistances> terms, std::size_t hits) {
  constexpr std::size_t kSample = 16'384;
  const std::size_t step = hits / kSample + 1;
  std::vector<float> absolute;
  for (const HitDistances& term : terms) {
    for (std::size_t i = 0; i < term.distance_m.size(); i += step) {
      absolute.push_back(std::abs(term.distance_m[i]));
    }
  }
  if (absolute.empty()) return 0;
  const auto middle = absolute.begin() + static_cast<std::ptrdiff_t>(absolute.size() / 2);
  std::nth_element(absolute.begin(), middle, absolute.end());
  return *middle;
}

}  // namespace

RegistrationScores scores_of(std::span<const HitDistances> terms) {
  std::size_t points = 0, hits = 0, inliers = 0, in_front = 0, beyond = 0;
  for (const HitDistances& term : terms) {
    points += term.points;
    hits += term.distance_m.size();
    for (const float distance : term.distance_m) {
      inliers += std::abs(distance) <= kInlierDistanceM;
      in_front += distance > kContradictionDistanceM;
      beyond += distance < -kContradictionDistanceM;
    }
  }
  RegistrationScores scores;
  scores.points = static_cast<std::uint32_t>(points);
  scores.hits = static_cast<std::uint32_t>(hits);
  scores.inlier_ratio_all = share(inliers, points);
  scores.inlier_ratio_hit = share(inliers, hits);
  scores.share_in_front = share(in_front, hits);
  scores.share_beyond = share(beyond, hits);
  scores.median_residual_m = median_residual_m(terms, hits);
  return scores;
}

double inlier_rmse_m(std::span<const HitDistances> terms) {
  double sum = 0;
  std::size_t inliers = 0;
  for (const HitDistances& term : terms) {
    for (const float distance : term.distance_m) {
      if (std::abs(distance) > kInlierDistanceM) continue;
      sum += static_cast<double>(distance) * distance;
      ++inliers;
    }
  }
  return inliers == 0 ? 0.0 : std::sqrt(sum / static_cast<double>(inliers));
}

RegistrationScores score_scan(const RegistrationTarget& target, const PointCloud& scan,
                              const Pose& T_cell_scan, std::size_t point_step) {
  const PointCloud thinned = point_step > 1 ? every_nth(scan, point_step) : PointCloud();
  MatchedTerm term({&target, point_step > 1 ? &thinned : &scan, false}, 1);
  const HitDistances hits = term.distances(T_cell_scan);
  return scores_of({&hits, 1});
}

bool is_acceptable(const RegistrationResult& result, const AcceptanceOptions& options) {
  const RegistrationScores& scores = result.scores;
  return result.converged && scores.hits > 0 &&
         scores.inlier_ratio_hit >= options.min_inlier_ratio_hit &&
         scores.share_in_front <= options.max_share_in_front &&
         scores.median_residual_m <= options.max_median_residual_m &&
         share(scores.hits, scores.points) >= options.min_hit_share &&
         scores.inlier_ratio_all >= options.min_inlier_ratio_all;
}

}  // namespace cellmap
