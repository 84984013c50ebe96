#pragma once

#include <cstddef>

#include "cellmap/core/stamp.hpp"
#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// One sweep of a LiDAR, points in the sensor frame. Clean: every point is finite and within the
/// range limits it was filtered with (`filter_scan`).
struct Scan {
  Stamp stamp = 0;
  PointCloud points;                   ///< sensor frame
  std::size_t dropped_non_finite = 0;  ///< points dropped for NaN or infinite coordinates
  std::size_t dropped_range = 0;       ///< points dropped for being too near or too far
};

/// What `filter_scan` keeps and corrects.
struct ScanFilterOptions {
  double min_range_m = 2.0;    ///< nearer points (the vehicle itself) are dropped
  double max_range_m = 120.0;  ///< farther points are dropped
  /// Turns every point up by this angle about the horizontal axis perpendicular to it. KITTI's
  /// HDL-64E intrinsics are off by 0.205 deg (paper, Sec. IV-A.1); 0 leaves points as they are.
  double vertical_angle_correction_deg = 0.0;

  /// Throws Error{kInvalidArgument} where 0 <= min < max <= 1000 or |angle| <= 5 does not hold.
  void validate() const;
};

/// Drops points that are not finite or out of range (counted), then corrects the vertical angle.
Scan filter_scan(PointCloud points, Stamp stamp, const ScanFilterOptions& options);

}  // namespace cellmap
