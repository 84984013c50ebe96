#pragma once

#include <cstddef>
#include <functional>
#include <stop_token>

namespace cellmap {

/// How far a long operation has come. `total` is 0 where it is not known.
struct Progress {
  std::size_t scans_done = 0;
  std::size_t scans_total = 0;
  std::size_t cells_done = 0;
};

/// Called from the working thread; must not block for long.
using ProgressCallback = std::function<void(const Progress&)>;

/// Throws Error{kCancelled} once a stop was requested.
void throw_if_stopped(const std::stop_token& stop);

}  // namespace cellmap
