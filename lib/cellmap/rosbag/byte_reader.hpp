#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap::ros_bag {

/// Reads the little-endian fields of a bag or a message one after the other; never beyond their
/// end. Every function throws Error{kCorruptData} where the bytes end.
class ByteReader {
 public:
  static_assert(std::endian::native == std::endian::little, "fields are read as they are");

  explicit ByteReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  std::size_t left() const { return bytes_.size(); }

  std::span<const std::byte> take(std::size_t count) {
    if (count > bytes_.size()) {
      throw Error(ErrorCode::kCorruptData, "expected " + std::to_string(count) +
                                               " more bytes, found " +
                                               std::to_string(bytes_.size()));
    }
    const auto taken = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return taken;
  }

  template <typename Number>
  Number number() {
    Number value;
    std::memcpy(&value, take(sizeof(Number)).data(), sizeof(Number));
    return value;
  }

  /// Four bytes of length, then the text.
  std::string text() {
    const auto bytes = take(number<std::uint32_t>());
    return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  }

 private:
  std::span<const std::byte> bytes_;
};

}  // namespace cellmap::ros_bag
