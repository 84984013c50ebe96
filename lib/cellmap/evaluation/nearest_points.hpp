#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// A k-d tree over points that stay where they are: the cloud must outlive it. Immutable and safe
/// to share between threads. About 0.7 us a query among a million points.
class NearestPoints {
 public:
  explicit NearestPoints(const PointCloud& points);
  ~NearestPoints();
  NearestPoints(NearestPoints&&) noexcept;

  struct Neighbour {
    std::uint32_t index = 0;
    float squared_distance_m2 = 0;
  };
  /// The nearest point. There must be one.
  Neighbour nearest(const Eigen::Vector3f& p) const;
  /// The nearest points, nearest first: as many as `found` has room for or there are, returned.
  std::size_t nearest(const Eigen::Vector3f& p, std::span<Neighbour> found) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
