#include "cellmap/core/hash.hpp"

#include <openssl/evp.h>

#include <charconv>
#include <memory>

#include "cellmap/core/error.hpp"

namespace cellmap {

ContentHash sha256(std::span<const std::byte> data) { return sha256_of_pieces({data}); }

ContentHash sha256_of_pieces(std::initializer_list<std::span<const std::byte>> pieces) {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(),
                                                                        EVP_MD_CTX_free);
  bool good = context && EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) == 1;
  for (const auto piece : pieces) {
    good = good && EVP_DigestUpdate(context.get(), piece.data(), piece.size()) == 1;
  }
  ContentHash hash;
  unsigned int length = 0;
  good = good && EVP_DigestFinal_ex(context.get(), hash.bytes.data(), &length) == 1;
  if (!good || length != hash.bytes.size()) {
    throw Error(ErrorCode::kInternal, "OpenSSL could not compute a SHA-256 digest");
  }
  return hash;
}

std::string to_hex(const ContentHash& hash) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string hex(2 * hash.bytes.size(), '0');
  char* digit = hex.data();
  for (const auto byte : hash.bytes) {
    *digit++ = kDigits[byte >> 4];
    *digit++ = kDigits[byte & 15];
  }
  return hex;
}

ContentHash content_hash_from_hex(const std::string& hex) {
  ContentHash hash;
  const auto fail = [&] {
    return Error(ErrorCode::kInvalidArgument, "a content hash has 64 hexadecimal digits, but '" +
                                                  hex.substr(0, 80) + "' was given");
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
