#include "cellmap/codec/index_coding.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {

void check_count(const std::vector<std::uint32_t>& indices, std::size_t count) {
  if (indices.size() == count) return;
  throw Error(ErrorCode::kCorruptData, "the coded index has " + std::to_string(indices.size()) +
                                           " planes in a layer, but the coded CELL says " +
                                           std::to_string(count));
}

}  // namespace cellmap
