#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "cellmap/scan/scan.hpp"

namespace cellmap {

/// Where one scan sits in its local map.
struct ScanInCell {
  Stamp stamp = 0;
  Pose T_cell_scan = Pose::Identity();
};

/// The rule by which a drive is cut into CELLs: true where a scan at this pose belongs to the next
/// one, strictly more than `cell_distance_m` from the base scan of this one.
bool begins_next_cell(const Pose& T_odom_base, const Pose& T_odom_sensor, double cell_distance_m);

/// Scans stacked by odometry pose until the next one is more than a set distance away (paper,
/// Sec. III-A). Mutable, one owner.
class LocalMap {
 public:
  /// Starts with its base scan, whose pose is the frame of the local map.
  LocalMap(Scan base_scan, const Pose& T_odom_base, std::uint32_t first_scan);

  /// `begins_next_cell` after the base scan.
  bool is_complete_for(const Pose& T_odom_sensor, double cell_distance_m) const;

  void add(const Scan& scan, const Pose& T_odom_sensor);

  const Pose& T_odom_cell() const { return T_odom_cell_; }
  const Scan& base_scan() const { return base_scan_; }
  std::uint32_t first_scan() const { return first_scan_; }
  const std::vector<ScanInCell>& scans() const { return scans_; }
  const PointCloud& points() const { return points_; }  ///< cell frame, all stacked scans
  /// Where the points of each scan end among them.
  const std::vector<std::size_t>& scan_ends() const { return scan_ends_; }

 private:
  Scan base_scan_;
  Pose T_odom_cell_;
  std::uint32_t first_scan_;
  std::vector<ScanInCell> scans_;
  PointCloud points_;
  std::vector<std::size_t> scan_ends_;
};

}  // namespace cellmap
