#include "cellmap/geometry/voxel_grid.hpp"

#include <array>

namespace cellmap {

void VoxelCounter::add(const PointCloud& cloud) {
  // Shifted to positive numbers, where cutting off the fraction is rounding down.
  constexpr double kOffset = 1 << 20;
  const auto key = [&](float v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(v * inverse_size_ + kOffset)) &
           0x1fffffU;
  };
  // Neighbours in a scan mostly share a voxel with one of the last few points.
  constexpr std::size_t kRecent = 256;
  std::array<std::uint64_t, kRecent> recent;
  recent.fill(~std::uint64_t{0});
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const std::uint64_t voxel = key(cloud.x[i]) << 42 | key(cloud.y[i]) << 21 | key(cloud.z[i]);
    std::uint64_t& known = recent[(voxel ^ voxel >> 19 ^ voxel >> 38) % kRecent];
    if (known == voxel) continue;
    known = voxel;
    occupied_.insert(voxel);
  }
}

}  // namespace cellmap
