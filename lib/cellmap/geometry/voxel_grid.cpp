#include "cellmap/geometry/voxel_grid.hpp"

#include <algorithm>
#include <bit>
#include <iterator>
#include <utility>

namespace cellmap {

std::vector<VoxelBlock> VoxelCounter::empty_table(std::size_t size) {
  return std::vector<VoxelBlock>(size, {kEmpty, 0});
}

/// Where the block is or would be.
std::size_t VoxelCounter::place_of(std::uint64_t key) const {
  const std::size_t mask = table_.size() - 1;
  std::size_t place = (key * 0x9E3779B97F4A7C15ULL >> 32) & mask;
  while (table_[place].key != key && table_[place].key != kEmpty) place = (place + 1) & mask;
  return place;
}

std::size_t VoxelCounter::find_or_insert(std::uint64_t key) {
  std::size_t place = place_of(key);
  if (table_[place].key == key) return place;
  if (2 * (blocks_ + 1) > table_.size()) {
    grow();
    place = place_of(key);
  }
  table_[place].key = key;
  ++blocks_;
  return place;
}

void VoxelCounter::grow() {
  const std::vector<VoxelBlock> old = std::exchange(table_, empty_table(2 * table_.size()));
  for (const VoxelBlock& block : old) {
    if (block.key != kEmpty) table_[place_of(block.key)] = block;
  }
}

void VoxelCounter::add(const PointCloud& cloud) {
  // Shifted to positive numbers, where cutting off the fraction is rounding down.
  constexpr double kOffset = 1 << 20;
  const auto voxel = [&](float v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(v * inverse_size_ + kOffset)) &
           0x1fffffU;
  };
  std::uint64_t last_key = kEmpty;
  std::size_t place = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::uint64_t x = voxel(cloud.x[i]), y = voxel(cloud.y[i]), z = voxel(cloud.z[i]);
    const std::uint64_t key = x >> 2 << 38 | y >> 2 << 19 | z >> 2;
    if (key != last_key) {
      place = find_or_insert(key);
      last_key = key;
    }
    std::uint64_t& occupied = table_[place].occupied;
    const std::uint64_t bit = std::uint64_t{1} << ((x & 3) << 4 | (y & 3) << 2 | (z & 3));
    voxels_ += (occupied & bit) == 0;
    occupied |= bit;
  }
}

void VoxelCounter::add(std::span<const VoxelBlock> blocks) {
  for (const VoxelBlock& block : blocks) {
    std::uint64_t& occupied = table_[find_or_insert(block.key)].occupied;
    voxels_ += static_cast<std::size_t>(std::popcount(block.occupied & ~occupied));
    occupied |= block.occupied;
  }
}

std::vector<VoxelBlock> VoxelCounter::blocks() const {
  std::vector<VoxelBlock> found;
  found.reserve(blocks_);
  std::ranges::copy_if(table_, std::back_inserter(found),
                       [](const VoxelBlock& block) { return block.key != kEmpty; });
  std::ranges::sort(found, {}, &VoxelBlock::key);
  return found;
}

void VoxelCounter::clear() {
  std::ranges::fill(table_, VoxelBlock{kEmpty, 0});
  voxels_ = blocks_ = 0;
}

}  // namespace cellmap
