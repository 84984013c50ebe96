#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// Occupied voxels of one block of 4 x 4 x 4.
struct VoxelBlock {
  std::uint64_t key = 0;       ///< where it is; below kVoxelKeys
  std::uint64_t occupied = 0;  ///< one bit a voxel
  bool operator==(const VoxelBlock&) const = default;
};
constexpr std::uint64_t kVoxelKeys = std::uint64_t{1} << 57;

/// Counts the occupied voxels of a growing cloud, which is the size of the voxel-downsampled cloud
/// that map sizes are compared with. Voxels are kept in blocks of 4 x 4 x 4, one bit each, in a
/// hash table with open addressing: neighbours in a scan mostly share a block. Memory: 32 to 64
/// bytes an occupied block.
class VoxelCounter {
 public:
  /// `voxel_size_m` > 0.
  explicit VoxelCounter(double voxel_size_m) : inverse_size_(1.0 / voxel_size_m) {}

  /// Adds points given in a common frame; coordinates up to +-2^20 voxels from the origin.
  void add(const PointCloud& cloud);

  /// Adds what another counter of the same voxels holds.
  void add(std::span<const VoxelBlock> blocks);

  std::size_t size() const { return voxels_; }
  /// All that is occupied, by key.
  std::vector<VoxelBlock> blocks() const;
  void clear();

 private:
  static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};

  static std::vector<VoxelBlock> empty_table(std::size_t size);
  std::size_t place_of(std::uint64_t key) const;
  std::size_t find_or_insert(std::uint64_t key);
  void grow();

  double inverse_size_;
  std::size_t voxels_ = 0, blocks_ = 0;
  std::vector<VoxelBlock> table_ = empty_table(1 << 10);  // a power of two, at most half full
};

}  // namespace cellmap
