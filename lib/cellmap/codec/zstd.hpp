#pragma once

#include <cstddef>
#include <span>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {

/// One zstd frame with its content size declared.
Bytes zstd_compress(std::span<const std::byte> data, int level = 3);

/// Decompresses exactly one frame that declares its size and fills it exactly. Throws
/// Error{kTooLarge} where it declares more than `max_size` (before allocating) and
/// Error{kCorruptData} for anything else that is wrong.
Bytes zstd_decompress(std::span<const std::byte> frame, std::size_t max_size);

}  // namespace cellmap
