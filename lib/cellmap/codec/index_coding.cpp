#include "cellmap/codec/index_coding.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {

bool IndexContexts::enter(std::uint32_t begin, int layer) {
  if (!sphere_.points.empty()) return false;  // points of a block do not follow one another
  const std::uint32_t first = layer == 0 ? 0 : 1, last = layer == 0 ? 0 : kCoarsePoints - 1;
  for (std::uint32_t rest = first; rest <= last; ++rest) {
    const auto& [offsets, least_step] = belts_.at(begin + rest);
    if (least_step < kIndexBlock) return false;
    std::array<std::uint8_t, kIndexBlock>& bits = of_block_[rest];
    bits.fill(0);
    for (const std::int32_t offset : offsets) {
      const std::uint8_t* const from = seen_ + static_cast<std::ptrdiff_t>(begin) + offset;
      for (std::uint32_t k = 0; k < kIndexBlock; ++k) {
        bits[k] = static_cast<std::uint8_t>(bits[k] << 1 | from[k]);
      }
    }
  }
  return true;
}

std::uint8_t IndexContexts::of(std::uint32_t point) const {
  std::uint32_t bits = 0;
  for (const std::int32_t offset : belts_.offsets_at(point)) {
    bits = bits << 1 | seen_[static_cast<std::ptrdiff_t>(point) + offset];
  }
  return static_cast<std::uint8_t>(bits);
}

std::uint64_t points_in_layer(const LatticeSphere& sphere, std::uint32_t begin, int layer) {
  const std::uint32_t count = std::min(kIndexBlock, sphere.count - begin);
  if (sphere.points.empty()) {
    constexpr std::uint64_t kCoarse = 0x1111111111111111;  // every fourth: a block begins at one
    return (layer == 0 ? kCoarse : ~kCoarse) & (~std::uint64_t{0} >> (kIndexBlock - count));
  }
  std::uint64_t points = 0;
  for (std::uint32_t k = 0; k < count; ++k) {
    points |= std::uint64_t{layer_of(sphere.point(begin + k)) == layer} << k;
  }
  return points;
}

void check_count(const std::vector<std::uint32_t>& indices, std::size_t count) {
  if (indices.size() == count) return;
  throw Error(ErrorCode::kCorruptData, "the coded index has " + std::to_string(indices.size()) +
                                           " planes in a layer, but the coded CELL says " +
                                           std::to_string(count));
}

}  // namespace cellmap
