#include "cellmap/core/checksum.hpp"

#define XXH_INLINE_ALL  // nothing to link, here and in what is built against the library
#include <xxhash.h>

namespace cellmap {

std::uint64_t checksum(std::span<const std::byte> data) {
  return XXH3_64bits(data.data(), data.size());
}

}  // namespace cellmap
