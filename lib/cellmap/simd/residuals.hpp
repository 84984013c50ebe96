#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "cellmap/simd/plane_table.hpp"

namespace cellmap::simd {

/// Points as three arrays, metres.
struct Points {
  const float *x, *y, *z;
};
struct MutablePoints {
  float *x, *y, *z;
};

/// p -> R p + t.
struct Motion {
  std::array<float, 9> R{};  ///< row by row
  std::array<float, 3> t{};
};

/// Moves `count` points. Each coordinate is ((r0 x + r1 y) + r2 z) + t, rounded after every
/// operation: the same bits on every instruction set, within 4 units in the last place of the
/// largest term.
void move(const Motion& motion, const Points& points, std::size_t count,
          const MutablePoints& moved);

/// Where the planes of lattice points lie in `table`, as PlaneTable::of. `place` may be
/// `lattice_index`.
void find_planes(const PlaneTable& table, const std::uint32_t* lattice_index, std::size_t count,
                 std::uint32_t* place);

/// The distance of each point from the plane at its place in the table,
/// ((nx x + ny y) + nz z) - offset, rounded after every operation as above.
void distances(const PlaneTable& table, const std::uint32_t* place, const Points& points,
               std::size_t count, float* distance);

/// How a point counts: not at all beyond the gate, else by the kernel of its distance d,
///   kOne 1,  kCauchy 1 / (1 + (d / width)^2),  kGemanMcClure the square of that,
///   kGiven its own.
enum class Weighting { kOne, kCauchy, kGemanMcClure, kGiven };
struct Weights {
  Weighting weighting = Weighting::kOne;
  float gate_m = 0;
  float inverse_width = 0;       ///< 1 / m
  const float* given = nullptr;  ///< one a point
};

/// Weighted sums over points of J J^T (upper triangle, row by row) and J d, where J = (n, p x n) is
/// the derivative of the distance for the left perturbation of the pose that moved p.
struct NormalSums {
  std::array<double, 21> jj{};
  std::array<double, 6> jd{};
  std::size_t points = 0;  ///< within the gate

  void add(const NormalSums& other);
};

/// Adds `count` points to `sums`. Each lane adds in float, to the doubles once every 512 points: of
/// terms of one size, the relative error is at most 512 / lanes units in the last place, and grows
/// with its square root where rounding is random.
void accumulate(const PlaneTable& table, const std::uint32_t* place, const Points& points,
                std::size_t count, const Weights& weights, NormalSums& sums);

}  // namespace cellmap::simd
