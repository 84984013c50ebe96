#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace cellmap::ros_bag {

/// The content of a chunk, which is `size` bytes long, by librosbag-storage's way with
/// `compression` ("none", "bz2" or "lz4"). Throws Error{kUnsupported} for another one,
/// {kCorruptData}.
std::vector<std::byte> decompress_chunk(std::span<const std::byte> bytes,
                                        const std::string& compression, std::size_t size);

}  // namespace cellmap::ros_bag
