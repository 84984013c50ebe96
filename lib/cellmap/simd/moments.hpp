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

  Moments operator+(const Moments& other) const {
    Moments total;
    total.count = count + other.count;
    for (std::size_t k = 0; k < 3; ++k) total.sum[k] = sum[k] + other.sum[k];
    for (std::size_t k = 0; k < 6; ++k) total.products[k] = products[k] + other.products[k];
    return total;
  }
  Moments operator-(const Moments& other) const {
    Moments difference;
    difference.count = count - other.count;
    for (std::size_t k = 0; k < 3; ++k) difference.sum[k] = sum[k] - other.sum[k];
    for (std::size_t k = 0; k < 6; ++k) difference.products[k] = products[k] - other.products[k];
    return difference;
  }
};

/// Arrays of points have room for a multiple of this, filled with the origin after the last point.
constexpr std::size_t kMomentLanes = 4;
constexpr std::size_t padded(std::size_t count) {
  return (count + kMomentLanes - 1) / kMomentLanes * kMomentLanes;
}

/// `count` >= 1 points of a patch, whose moments are taken about `origin`.
struct PatchView {
  const float *x, *y, *z;
  std::size_t count;
  std::array<float, 3> origin;
};

/// The extremes of (x x + y y) + z z over the points, and the origin where they are not a multiple
/// of four.
struct SquaredRanges {
  double min, max;
};

/// Writes the ranges sqrt((x x + y y) + z z) of the points, `padded(count)` of them.
void ranges(const PatchView& points, double* ranges_m);

Moments moments(const PatchView& points);

/// Both in one pass.
struct MomentsAndRanges {
  Moments moments;
  SquaredRanges squared_ranges;
};
MomentsAndRanges moments_and_ranges(const PatchView& points);

/// Moments of the points for which |(nx x + ny y) + nz z - offset| > limit, for points
/// about the origin.
Moments moments_off_plane(const PatchView& points, const std::array<double, 3>& normal,
                          double offset, double limit);

}  // namespace cellmap::simd
