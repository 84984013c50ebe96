#include "cellmap/codec/index_coding.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {

void IndexContexts::enter(std::uint32_t begin, int layer) {
  is_whole_ = false;
  if (!sphere_.points.empty()) return;  // points of a block do not follow one another
  const std::uint32_t first = layer == 0 ? 0 : 1, last = layer == 0 ? 0 : kCoarsePoints - 1;
  for (std::uint32_t rest = first; rest <= last; ++rest) {
    const auto& [offsets, least_step] = belts_.at(begin + rest);
    if (least_step < kIndexBlock) return;
    std::array<std::uint8_t, kIndexBlock>& bits = of_block_[rest];
    bits.fill(0);
    for (const std::int32_t offset : offsets) {
      const std::uint8_t* const from = seen_ + static_cast<std::ptrdiff_t>(begin) + offset;
      for (std::uint32_t k = 0; k < kIndexBlock; ++k) {
        bits[k] = static_cast<std::uint8_t>(bits[k] << 1 | from[k]);
      }
    }
  }
  is_whole_ = true;
}

std::uint8_t IndexContexts::single(std::uint32_t point) const {
  std::uint32_t bits = 0;
  for (const std::int32_t offset : belts_.offsets_at(point)) {
    bits = bits << 1 | seen_[static_cast<std::ptrdiff_t>(point) + offset];
  }
  return static_cast<std::uint8_t>(bits);
}

void check_count(const std::vector<std::uint32_t>& indices, std::size_t count) {
  if (indices.size() == count) return;
  throw Error(ErrorCode::kCorruptData, "the coded index has " + std::to_string(indices.size()) +
                                           " planes in a layer, but the coded CELL says " +
                                           std::to_string(count));
}

}  // namespace cellmap
