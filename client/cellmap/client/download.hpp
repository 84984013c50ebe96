#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>

#include "cellmap/archive/byte_source.hpp"

// Not installed.

namespace cellmap::client {

/// Copies all of `from` into `to`, piece by piece; anew, a few times, where it changed meanwhile.
/// Throws Error{kCancelled} when stopped, and what the two throw.
void download(ByteSource& from, ByteFile& to, const std::stop_token& stop,
              const std::function<void(std::uint64_t done, std::uint64_t total)>& progress);

}  // namespace cellmap::client
