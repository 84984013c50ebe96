#pragma once

#include <cstddef>
#include <string>

#include "cellmap/core/hash.hpp"

namespace cellmap {

/// Text of `bytes` random bytes of the operating system's generator (OpenSSL), in base64url without
/// padding: 43 characters for 32 bytes. Throws Error{kInternal} where there is no randomness.
std::string random_text(std::size_t bytes);

/// Takes the same time wherever they differ (OpenSSL).
bool equal_in_constant_time(const ContentHash& a, const ContentHash& b);

}  // namespace cellmap
