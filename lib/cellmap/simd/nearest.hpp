#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace cellmap::simd {

/// What the kernel knows of a Fibonacci lattice: no table of points, a few numbers for each of a
/// handful of latitude zones (geometry/lattice.hpp says why four corners are enough there).
struct FibonacciZones {
  static constexpr std::size_t kMost = 16;

  /// M, at most 2^20: indices and their products with steps are exact floats. Lattice point i lies
  /// at the height 1 - 2 (i + first) / M.
  float points = 0;
  float first = 0.5f;    ///< 0.5: M = N points between the poles; 0: M = N - 1, the first is a pole
  float last_turns = 0;  ///< azimuth of the last lattice point
  float cap_r2 = 0;      ///< nearer to the axis than this the kernel does not decide
  /// Squared chords closer than this are not told apart.
  float guard = 0;
  std::size_t count = 0;
  /// By zone, from the equator to the caps; a zone begins at a circle of latitude of this squared
  /// radius, the last one reaches to the cap.
  std::array<float, kMost> min_r2{};
  /// The reduced basis of the zone, two steps a and b in indices and in turns of azimuth, with
  /// index_a turns_b - index_b turns_a = 1.
  std::array<float, kMost> index_a{}, index_b{}, turns_a{}, turns_b{};
};

/// Written where the kernel does not decide: in the caps, where the two nearest lattice points are
/// as good as equally far, and where a direction is no finite one.
constexpr std::uint32_t kUndecided = 0xFFFF'FFFF;

/// The lattice point nearest to each of `count` directions of any length, or `kUndecided`, whose
/// positions are written to `undecided` (room for `count`). Returns how many there are: about 1 in
/// 1,000 outside the caps. What is decided is right whatever the instruction set.
///
/// Per direction: height and azimuth in float, coordinates in the basis of the zone
///   a = turns_b i - index_b t,  b = index_a t - turns_a i
/// for the real index i and the azimuth t, and of the four corners of the parallelogram that holds
/// them the one with the least squared chord
///   dz^2 + (r - r')^2 + r r' (2 - 2 cos da),
/// every term of which is formed from small differences, so that nothing cancels. In the zone of
/// the equator, which holds nearly all rays of a LiDAR, its expansion to third order serves.
/// Elsewhere both hemispheres are treated as the northern one (lattice point N - 1 - i lies at the
/// height -z_i and at the azimuth t_(N-1) - t_i), where 1 - z keeps its relative precision.
///
/// Positions are good to about 5e-5 of a point spacing: of 24-bit floats, 3e-8 turns of azimuth and
/// 6e-8 of height weigh most against the spacing of a million points. The difference of two squared
/// chords is then good to about 2e-4 squared spacings; a `guard` of three times that is on the safe
/// side. At the equator the guard follows the spacing and what the expansion leaves out: without it
/// the largest gap that was decided wrongly is a fourth of it for N = 1,000,000 and a sixteenth for
/// N = 50,000.
std::size_t nearest(const FibonacciZones& zones, const float* x, const float* y, const float* z,
                    std::size_t count, std::uint32_t* index, std::uint32_t* undecided);

/// Three arrays of doubles: x, y and z of some directions.
struct Directions {
  const double *x, *y, *z;
};

/// The position in [begin, end) of the direction with the largest dot product with (x, y, z),
/// formed as x x + y y + z z from left to right in double; of equal ones the last if `last_wins`,
/// else the first.
std::size_t largest_dot(const Directions& directions, std::size_t begin, std::size_t end,
                        const double direction[3], bool last_wins);

}  // namespace cellmap::simd
