#pragma once

#include <cstddef>
#include <cstdint>

namespace cellmap::simd {

/// The rings that the points of a Fibonacci sphere lie on: point i at the height
///   z = (divisor - a) / divisor,  a = 2 i + offset,
/// and at the azimuth frac(i / phi) turns.
struct FibonacciRings {
  std::uint32_t divisor;  ///< at most 2^20
  std::uint32_t offset;   ///< 1: the first and last points lie beside the poles; 0: on them
};

/// Writes the directions of the points `index`[k], k < count, each at most `divisor`: by the
/// integers and IEEE operations that FORMAT.md, "Lattices", prescribes, and therefore with the same
/// bits on every instruction set. About 3 ns each with AVX2.
void directions(const FibonacciRings& rings, const std::uint32_t* index, std::size_t count,
                double* x, double* y, double* z);

}  // namespace cellmap::simd
