#pragma once

#include <array>
#include <cstddef>

namespace cellmap::simd {

/// Sums over the points of a patch, in double. Everything in this header is rounded after every
/// operation and summed in the same order whatever the width of a vector, so results have the same
/// bits on every instruction set: point i is added to the sum i mod 4, and the four sums s to
/// (s0 + s2) + (s1 + s3).
struct Moments {
  double count = 0;
  std::array<double, 3> sum{};       ///< x, y, z
  std::array<double, 6> products{};  ///< xx, xy, xz, yy, yz, zz

  Moments operator-(const Moments& other) const;
};

/// Arrays of points have room for a multiple of this, filled with the first point after the last.
constexpr std::size_t kMomentLanes = 4;
constexpr std::size_t padded(std::size_t count) {
  return (count + kMomentLanes - 1) / kMomentLanes * kMomentLanes;
}

/// `count` >= 1 points of a patch. Their moments are taken about the first one.
struct PatchView {
  const float *x, *y, *z;
  std::size_t count;
};

struct SquaredRanges {
  double min, max;
};

/// The extremes of (x x + y y) + z z.
SquaredRanges squared_ranges(const PatchView& points);

/// Writes their square roots, `padded(count)` of them.
void ranges(const PatchView& points, double* ranges_m);

Moments moments(const PatchView& points);

/// Moments of the points for which |(nx x + ny y) + nz z - offset| > limit, about the first point
/// as well.
Moments moments_off_plane(const PatchView& points, const std::array<double, 3>& normal,
                          double offset, double limit);

}  // namespace cellmap::simd
