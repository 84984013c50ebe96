#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace cellmap {

/// A SHA-256 digest. Names the exact bytes of a stored object.
struct ContentHash {
  std::array<std::uint8_t, 32> bytes{};
  auto operator<=>(const ContentHash&) const = default;
};

/// SHA-256 of `data` (OpenSSL).
ContentHash sha256(std::span<const std::byte> data);

/// 64 lower-case hexadecimal digits.
std::string to_hex(const ContentHash& hash);

/// Inverse of `to_hex`. Throws Error{kInvalidArgument} for anything but 64 hexadecimal digits.
ContentHash content_hash_from_hex(const std::string& hex);

}  // namespace cellmap
