#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// The stretch of a drive that becomes one CELL.
struct DriveStretch {
  std::uint32_t sequence = 0;  ///< of the CELL in its session
  std::uint64_t first_scan = 0;
  std::uint64_t scan_count = 0;
  bool operator==(const DriveStretch&) const = default;
};

/// Where a drive, from scan `first_scan` on, is cut into CELLs that are numbered from
/// `first_sequence` on: just as a `FrontEnd` cuts it, before a scan is read. `odometry`:
/// T_odom_sensor of every scan of the drive.
std::vector<DriveStretch> cut_drive(std::span<const Pose> odometry, std::uint64_t first_scan,
                                    std::uint32_t first_sequence, double cell_distance_m);

}  // namespace cellmap
