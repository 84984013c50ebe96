#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/geometry/lattice.hpp"
#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// A scan by direction: what it sees along a ray, in one look-up. Built once for a query and asked
/// for every pose that is tried. Patches of about 2.3 deg, so that a thinned scan has points in the
/// directions that it covers. Immutable and safe to share between threads. About 0.6 ms for 30,000
/// points.
class ScanView {
 public:
  /// Points that are not finite, or the origin, have no direction and are left out.
  explicit ScanView(const PointCloud& scan);

  struct Point {
    Eigen::Vector3f position;
    float range_m;
  };
  const PointCloud& points() const { return scan_; }

  /// The patch of each of the points, Lattice::kNowhere where it has none.
  std::vector<std::uint32_t> patches_of(const PointCloud& points) const;
  std::span<const Point> along(std::uint32_t patch) const {
    return std::span(sorted_).subspan(begin_[patch], begin_[patch + 1] - begin_[patch]);
  }

 private:
  Lattice lattice_;
  PointCloud scan_;
  std::vector<std::uint32_t> begin_;  // of each patch in sorted_
  std::vector<Point> sorted_;
};

/// What a scan says of one plane of a CELL, by the points in its direction. `at` is where the plane
/// meets the ray from its CELL, `normal` its normal, both in the frame of the scan.
struct PlaneSeen {
  bool confirmed = false;    ///< a point lies at its range, within 0.5 m or 5 %
  bool tight = false;        ///< and within 0.1 m of the plane
  bool hidden = true;        ///< every point is nearer
  bool seen_through = true;  ///< every point is farther, by over 1 m and 10 %

  PlaneSeen(std::span<const ScanView::Point> points, const Eigen::Vector3f& at,
            const Eigen::Vector3f& normal);
};

}  // namespace cellmap
