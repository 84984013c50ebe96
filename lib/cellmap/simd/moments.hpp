#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

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

/// Arrays of points have room for a multiple of this and are zero after the last point.
constexpr std::size_t kMomentLanes = 4;
constexpr std::size_t padded(std::size_t count) {
  return (count + kMomentLanes - 1) / kMomentLanes * kMomentLanes;
}

/// Points about an origin.
struct CentredPoints {
  const double *x, *y, *z;
  std::size_t count;
};

/// A point, metres, and the lattice point whose patch it lies in.
struct alignas(16) PatchPoint {
  float x, y, z;
  std::uint32_t patch;
};

struct SquaredRanges {
  double min, max;
};

/// Writes `count` >= 1 points minus the first one to x, y and z (room for `padded(count)`, filled
/// with zeros); returns the extremes of x x + y y + z z.
SquaredRanges centre(const PatchPoint* points, std::size_t count, double* x, double* y, double* z);

Moments moments(const CentredPoints& points);

/// Moments of the points for which |(nx x + ny y) + nz z - offset| > limit.
Moments moments_off_plane(const CentredPoints& points, const std::array<double, 3>& normal,
                          double offset, double limit);

}  // namespace cellmap::simd
