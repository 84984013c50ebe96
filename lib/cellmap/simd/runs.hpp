#pragma once

#include <cstddef>
#include <cstdint>

namespace cellmap::simd {

/// Where runs of equal values begin: writes to `start` the positions i < count with i = 0 or
/// value[i] != value[i - 1], ascending, and returns how many there are. `start` has room for
/// `count` and kRunsRoom more, whose contents are lost.
constexpr std::size_t kRunsRoom = 16;
std::size_t run_starts(const std::uint32_t* value, std::size_t count, std::uint32_t* start);

}  // namespace cellmap::simd
