#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "cellmap/evaluation/nearest_points.hpp"
#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/triangle_mesh.hpp"

namespace cellmap {

/// Distances at which the F-score is told, metres.
constexpr std::array kFScoreDistancesM = {0.05, 0.1, 0.2};
/// Distances above this count as this: what is not there at all would else decide the mean.
constexpr double kReconstructionLimitM = 0.5;

/// How well a reconstruction agrees with the points that it stands for.
struct ReconstructionErrors {
  double accuracy_m = 0;      ///< mean distance from the reconstruction to the nearest point
  double completeness_m = 0;  ///< mean distance from the points to the reconstruction
  /// Harmonic mean of the shares of both distances that are within kFScoreDistancesM, in [0, 1].
  std::array<double, kFScoreDistancesM.size()> f_score{};
};

/// The errors from the distances of both ways; all NaN where one way has none.
ReconstructionErrors reconstruction_errors(std::span<const double> from_reconstruction_m,
                                           std::span<const double> from_points_m);

/// Distances of `from` from the nearest of `points`, at most kReconstructionLimitM. The same for
/// any thread count (0: all).
std::vector<double> distances_to_points(const PointCloud& from, const NearestPoints& points,
                                        int threads);
/// The same from the surface of a mesh.
std::vector<double> distances_to_surface(const PointCloud& from, const TriangleMesh& mesh,
                                         int threads);

}  // namespace cellmap
