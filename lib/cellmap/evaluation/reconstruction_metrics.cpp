#include "cellmap/evaluation/reconstruction_metrics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "cellmap/core/parallel.hpp"
#include "cellmap/evaluation/surface_index.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kPointsAtOnce = 1024;

double mean(std::span<const double> values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double share_within(std::span<const double> distances_m, double limit_m) {
  const auto within = std::count_if(distances_m.begin(), distances_m.end(),
                                    [&](double distance) { return distance <= limit_m; });
  return static_cast<double>(within) / static_cast<double>(distances_m.size());
}

template <typename DistanceOf>
std::vector<double> distances(const PointCloud& from, int threads, const DistanceOf& distance_of) {
  std::vector<double> result(from.size());
  parallel_for(from.size(), kPointsAtOnce, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) result[i] = distance_of(from[i]);
  });
  return result;
}

}  // namespace

ReconstructionErrors reconstruction_errors(std::span<const double> from_reconstruction_m,
                                           std::span<const double> from_points_m) {
  ReconstructionErrors errors;
  if (from_reconstruction_m.empty() || from_points_m.empty()) {
    errors.accuracy_m = errors.completeness_m = std::numeric_limits<double>::quiet_NaN();
    errors.f_score.fill(std::numeric_limits<double>::quiet_NaN());
    return errors;
  }
  errors.accuracy_m = mean(from_reconstruction_m);
  errors.completeness_m = mean(from_points_m);
  for (std::size_t k = 0; k < kFScoreDistancesM.size(); ++k) {
    const double precision = share_within(from_reconstruction_m, kFScoreDistancesM[k]);
    const double recall = share_within(from_points_m, kFScoreDistancesM[k]);
    const double sum = precision + recall;
    errors.f_score[k] = sum > 0 ? 2 * precision * recall / sum : 0.0;
  }
  return errors;
}

std::vector<double> distances_to_points(const PointCloud& from, const NearestPoints& points,
                                        int threads) {
  return distances(from, threads, [&](const Eigen::Vector3f& p) {
    const double squared = points.nearest(p).squared_distance_m2;
    return std::min(std::sqrt(squared), kReconstructionLimitM);
  });
}

std::vector<double> distances_to_surface(const PointCloud& from, const TriangleMesh& mesh,
                                         int threads) {
  const SurfaceIndex index(mesh, kReconstructionLimitM);
  return distances(from, threads,
                   [&](const Eigen::Vector3f& p) { return index.distance(p.cast<double>()); });
}

}  // namespace cellmap
