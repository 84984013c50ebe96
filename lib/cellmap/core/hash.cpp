#include "cellmap/core/hash.hpp"

#include <charconv>

#include <openssl/evp.h>

#include "cellmap/core/error.hpp"

namespace cellmap {

ContentHash sha256(std::span<const std::byte> data) {
  ContentHash hash;
  unsigned int length = 0;
  if (EVP_Digest(data.data(), data.size(), hash.bytes.data(), &length, EVP_sha256(), nullptr) != 1 ||
      length != hash.bytes.size()) {
    throw Error(ErrorCode::kInternal, "OpenSSL could not compute a SHA-256 digest");
  }
  return hash;
}

std::string to_hex(const ContentHash& hash) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string hex;
  hex.reserve(2 * hash.bytes.size());
  for (const std::uint8_t byte : hash.bytes) {
    hex += kDigits[byte >> 4];
    hex += kDigits[byte & 15];
  }
  return hex;
}

ContentHash content_hash_from_hex(const std::string& hex) {
  ContentHash hash;
  const auto fail = [&] {
    return Error(ErrorCode::kInvalidArgument,
                 "a content hash has 64 hexadecimal digits, but '" + hex.substr(0, 80) +
                     "' was given");
  };
  if (hex.size() != 2 * hash.bytes.size()) throw fail();
  for (std::size_t i = 0; i < hash.bytes.size(); ++i) {
    const char* begin = hex.data() + 2 * i;
    const auto [end, error] = std::from_chars(begin, begin + 2, hash.bytes[i], 16);
    if (error != std::errc() || end != begin + 2) throw fail();
  }
  return hash;
}

}  // namespace cellmap
