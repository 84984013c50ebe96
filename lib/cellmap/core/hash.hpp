#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
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

/// SHA-256 of the concatenation of `pieces`.
ContentHash sha256_of_pieces(std::initializer_list<std::span<const std::byte>> pieces);

/// 64 lower-case hexadecimal digits.
std::string to_hex(const ContentHash& hash);

/// Inverse of `to_hex`. Throws Error{kInvalidArgument} for anything but 64 hexadecimal digits.
ContentHash content_hash_from_hex(const std::string& hex);

}  // namespace cellmap
