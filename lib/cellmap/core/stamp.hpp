#pragma once

#include <cstdint>

namespace cellmap {

/// A point in time in integer nanoseconds since the epoch of its source (Unix time, or the start
/// of the drive for data sets that count from zero). Integers, because a double loses
/// microseconds in Unix time.
using Stamp = std::int64_t;

constexpr double kNanosecondsPerSecond = 1e9;

constexpr double to_seconds(Stamp stamp) {
  return static_cast<double>(stamp) / kNanosecondsPerSecond;
}

/// Rounds to the nearest nanosecond.
constexpr Stamp stamp_from_seconds(double seconds) {
  return static_cast<Stamp>(seconds * kNanosecondsPerSecond + (seconds < 0 ? -0.5 : 0.5));
}

}  // namespace cellmap
