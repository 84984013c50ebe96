#include "cellmap/rosbag/decompress.hpp"

#include <rosbag/stream.h>

#include <algorithm>

#include "cellmap/core/error.hpp"

namespace cellmap::ros_bag {

std::vector<std::byte> decompress_chunk(std::span<const std::byte> bytes,
                                        const std::string& compression, std::size_t size) {
  rosbag::CompressionType type = rosbag::compression::Uncompressed;
  if (compression == "bz2") {
    type = rosbag::compression::BZ2;
  } else if (compression == "lz4") {
    type = rosbag::compression::LZ4;
  } else if (compression != "none") {
    throw Error(ErrorCode::kUnsupported,
                "expected a chunk compressed by none, bz2 or lz4, found another way");
  } else if (size != bytes.size()) {
    throw Error(ErrorCode::kCorruptData, "a chunk's size contradicts its bytes");
  }
  std::vector<std::byte> content(size);
  if (type == rosbag::compression::Uncompressed) {
    std::ranges::copy(bytes, content.begin());
    return content;
  }
  // Its functions take what they only read as if they wrote to it.
  auto* source = const_cast<std::uint8_t*>(reinterpret_cast<const std::uint8_t*>(bytes.data()));
  try {
    rosbag::StreamFactory(nullptr).getStream(type)->decompress(
        reinterpret_cast<std::uint8_t*>(content.data()), static_cast<unsigned>(size), source,
        static_cast<unsigned>(bytes.size()));
  } catch (const rosbag::BagException& error) {
    throw Error(ErrorCode::kCorruptData,
                "a chunk cannot be decompressed: " + std::string(error.what()));
  }
  return content;
}

}  // namespace cellmap::ros_bag
