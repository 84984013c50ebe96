#include "cellmap/geometry/voxel_grid.hpp"

#include <cmath>

namespace cellmap {

void VoxelCounter::add(const PointCloud& cloud) {
  constexpr std::int64_t kOffset = std::int64_t{1} << 20;
  const auto key = [&](float v) {
    const auto index = static_cast<std::int64_t>(std::floor(v * inverse_size_)) + kOffset;
    return static_cast<std::uint64_t>(index) & 0x1fffffU;
  };
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    occupied_.insert(key(cloud.x[i]) << 42 | key(cloud.y[i]) << 21 | key(cloud.z[i]));
  }
}

}  // namespace cellmap
