#include "cellmap/cell/local_map.hpp"

namespace cellmap {

bool begins_next_cell(const Pose& T_odom_base, const Pose& T_odom_sensor, double cell_distance_m) {
  return (T_odom_sensor.translation() - T_odom_base.translation()).norm() > cell_distance_m;
}

LocalMap::LocalMap(Scan base_scan, const Pose& T_odom_base, std::uint32_t first_scan)
    : base_scan_(std::move(base_scan)),
      T_odom_cell_(T_odom_base),
      first_scan_(first_scan),
      scans_{{base_scan_.stamp, Pose::Identity()}},
      scan_ends_{base_scan_.points.size()} {
  // Room that nothing touches until it is needed: growing later would copy all points when one more
  // scan comes.
  constexpr std::size_t kUsualScans = 16;
  points_.reserve(kUsualScans * base_scan_.points.size());
  points_.append(base_scan_.points);
}

bool LocalMap::is_complete_for(const Pose& T_odom_sensor, double cell_distance_m) const {
  return begins_next_cell(T_odom_cell_, T_odom_sensor, cell_distance_m);
}

void LocalMap::add(const Scan& scan, const Pose& T_odom_sensor) {
  const Pose T_cell_scan = T_odom_cell_.inverse() * T_odom_sensor;
  scans_.push_back({scan.stamp, T_cell_scan});
  points_.append(transformed(scan.points, T_cell_scan));
  scan_ends_.push_back(points_.size());
}

}  // namespace cellmap
