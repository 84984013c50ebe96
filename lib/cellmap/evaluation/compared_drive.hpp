#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/scan/scan.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// A scan and where it was taken.
struct PlacedScan {
  Scan scan;  ///< sensor frame, filtered
  Pose T_map_scan = Pose::Identity();
};

/// A drive from which every representation is built, in memory: 12 bytes a point.
struct ComparedDrive {
  std::vector<PlacedScan> mapped;     ///< what maps are made of, in order
  std::vector<PlacedScan> held_back;  ///< what asks them where it is
  double length_m = 0;                ///< driven, from the first scan to the last
};

/// Reads a drive and holds `held_back` of its scans back, evenly spread and never the first; the
/// first scan is the map's origin. Poses are the drive's ground truth where `use_truth` and it
/// carries one, else its odometry. Throws Error{kInvalidArgument} where fewer than two scans would
/// be left to map, and what the source throws.
ComparedDrive read_compared_drive(ScanSource& source, const ScanFilterOptions& filter,
                                  std::size_t held_back, bool use_truth,
                                  const std::function<void(std::size_t scans_done)>& progress = {});

/// All mapped points, map frame.
PointCloud stacked_points(const ComparedDrive& drive);

/// The voxel of each point; voxels are numbered in the order in which they were met. Coordinates up
/// to 2^20 voxels from the origin.
std::vector<std::size_t> voxels_of(const PointCloud& points, double voxel_m);

/// One point a voxel, the mean of the points within; in the order in which voxels were met.
/// Deterministic. Coordinates up to 2^20 voxels from the origin.
PointCloud voxel_means(const PointCloud& points, double voxel_m);

}  // namespace cellmap
