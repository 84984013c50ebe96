#include "cellmap/codec/index_coding.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {

std::vector<std::uint32_t> indices_of(const std::vector<std::uint8_t>& has_plane,
                                      std::size_t count) {
  std::vector<std::uint32_t> indices;
  for (std::uint32_t i = 0; i < has_plane.size(); ++i) {
    if (has_plane[i]) indices.push_back(i);
  }
  if (indices.size() == count) return indices;
  throw Error(ErrorCode::kCorruptData, "the coded index has " + std::to_string(indices.size()) +
                                           " planes, but the coded CELL says " +
                                           std::to_string(count));
}

}  // namespace cellmap
