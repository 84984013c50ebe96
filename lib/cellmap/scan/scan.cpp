#include "cellmap/scan/scan.hpp"

#include <cmath>
#include <numbers>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// Turns a point up by an angle about the horizontal axis perpendicular to it; its range stays.
Eigen::Vector3f turned_up(const Eigen::Vector3d& p, double cos, double sin) {
  const double rho = std::hypot(p.x(), p.y());
  if (rho == 0) return p.cast<float>();  // straight up or down: there is no such axis
  const double scale = cos - sin * p.z() / rho;
  return Eigen::Vector3d(p.x() * scale, p.y() * scale, p.z() * cos + rho * sin).cast<float>();
}

}  // namespace

void ScanFilterOptions::validate() const {
  if (!(min_range_m >= 0 && min_range_m < max_range_m && max_range_m <= 1000)) {
    throw Error(ErrorCode::kInvalidArgument,
                "scan ranges must hold 0 <= min_range_m < max_range_m <= 1000; given are " +
                    std::to_string(min_range_m) + " and " + std::to_string(max_range_m));
  }
  if (!(std::abs(vertical_angle_correction_deg) <= 5)) {
    throw Error(ErrorCode::kInvalidArgument,
                "vertical_angle_correction_deg must be within -5 and 5; given is " +
                    std::to_string(vertical_angle_correction_deg));
  }
}

Scan filter_scan(PointCloud points, Stamp stamp, const ScanFilterOptions& options) {
  options.validate();
  const double angle = options.vertical_angle_correction_deg * std::numbers::pi / 180;
  const double cos = std::cos(angle), sin = std::sin(angle);
  const double min2 = options.min_range_m * options.min_range_m;
  const double max2 = options.max_range_m * options.max_range_m;

  Scan scan{.stamp = stamp, .points = std::move(points)};
  std::size_t kept = 0;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const Eigen::Vector3f p = scan.points[i];
    const Eigen::Vector3d wide = p.cast<double>();
    const double range2 = wide.squaredNorm();
    if (!p.allFinite()) {
      ++scan.dropped_non_finite;
    } else if (range2 < min2 || range2 > max2 || range2 == 0) {
      ++scan.dropped_range;
    } else {
      const Eigen::Vector3f moved = angle == 0 ? p : turned_up(wide, cos, sin);
      scan.points.x[kept] = moved.x();
      scan.points.y[kept] = moved.y();
      scan.points.z[kept] = moved.z();
      ++kept;
    }
  }
  scan.points.x.resize(kept);
  scan.points.y.resize(kept);
  scan.points.z.resize(kept);
  return scan;
}

}  // namespace cellmap
