#include "cellmap/pipeline/cut_drive.hpp"

#include "cellmap/cell/local_map.hpp"

namespace cellmap {

std::vector<DriveStretch> cut_drive(std::span<const Pose> odometry, std::uint64_t first_scan,
                                    std::uint32_t first_sequence, double cell_distance_m) {
  std::vector<DriveStretch> stretches;
  for (std::uint64_t scan = first_scan; scan < odometry.size(); ++scan) {
    const bool begins = stretches.empty() || begins_next_cell(odometry[stretches.back().first_scan],
                                                              odometry[scan], cell_distance_m);
    if (begins) {
      stretches.push_back({first_sequence + static_cast<std::uint32_t>(stretches.size()), scan, 0});
    }
    ++stretches.back().scan_count;
  }
  return stretches;
}

}  // namespace cellmap
