#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/geometry/pose.hpp"

namespace cellmap::test {

/// Points between 3 and 40 m, where neighbouring scans are dense enough to compare.
inline PointCloud middle_range(const PointCloud& scan) {
  PointCloud kept;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const float range = scan[i].norm();
    if (range > 3 && range < 40) kept.push_back(scan[i]);
  }
  return kept;
}

/// Median distance in metres from about 400 points of scan `b`, moved by `T_a_b`, to the nearest
/// point of scan `a`. Small only where the pose between the scans is right, turned and not
/// mirrored: walls, poles and cars must fall on one another.
inline double median_nearest_m(const PointCloud& a, const PointCloud& b, const Pose& T_a_b) {
  const PointCloud target = middle_range(a);
  const PointCloud candidates = middle_range(b);
  const PointCloud queries =
      transformed(every_nth(candidates, std::max<std::size_t>(1, candidates.size() / 400)), T_a_b);
  std::vector<double> distances;
  for (std::size_t q = 0; q < queries.size(); ++q) {
    float nearest = std::numeric_limits<float>::max();
    for (std::size_t i = 0; i < target.size(); ++i) {
      const float dx = target.x[i] - queries.x[q];
      const float dy = target.y[i] - queries.y[q];
      const float dz = target.z[i] - queries.z[q];
      nearest = std::min(nearest, dx * dx + dy * dy + dz * dz);
    }
    distances.push_back(std::sqrt(nearest));
  }
  std::nth_element(distances.begin(), distances.begin() + distances.size() / 2, distances.end());
  return distances[distances.size() / 2];
}

}  // namespace cellmap::test
