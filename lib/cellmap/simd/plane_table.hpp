#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace cellmap::simd {

/// A plane: unit normal and offset. A point's distance is n . p - offset.
struct HessePlane {
  float nx, ny, nz, offset_m;
};
static_assert(sizeof(HessePlane) == 4 * sizeof(float));

/// That of points without a plane: beyond any gate.
constexpr HessePlane kNoPlane = {0, 0, 0, HUGE_VALF};

/// The planes of the lattice points [first, first + count), kNoPlane where a patch has none, and
/// kNoPlane once more at the end, for all other lattice points.
struct PlaneTable {
  const HessePlane* planes = nullptr;
  std::uint32_t first = 0, count = 0;

  const HessePlane& of(std::uint32_t lattice_index) const {
    return planes[std::min(lattice_index - first, count)];  // wraps around below the first
  }
};

}  // namespace cellmap::simd
