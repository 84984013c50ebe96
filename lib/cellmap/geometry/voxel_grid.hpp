#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_set>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// Counts the occupied voxels of a growing cloud, which is the size of the voxel-downsampled cloud
/// that map sizes are compared with. Memory: about 40 bytes an occupied voxel.
class VoxelCounter {
 public:
  /// `voxel_size_m` > 0.
  explicit VoxelCounter(double voxel_size_m) : inverse_size_(1.0 / voxel_size_m) {}

  /// Adds points given in a common frame; coordinates up to +-2^20 voxels from the origin.
  void add(const PointCloud& cloud);

  std::size_t size() const { return occupied_.size(); }

 private:
  double inverse_size_;
  std::unordered_set<std::uint64_t> occupied_;
};

}  // namespace cellmap
