#pragma once

#include <array>
#include <cstddef>

#include "cellmap/simd/moments.hpp"

namespace cellmap::simd {

/// Some sets of moments side by side, and the total least squares plane of each: its normal is the
/// eigenvector of the smallest eigenvalue of the covariance. Solved in closed form, many at once,
/// by +, -, *, / and square roots alone, each rounded: the same bits on every instruction set.
struct PlaneBatch {
  static constexpr std::size_t kSize = 8;
  using Values = std::array<double, kSize>;

  void set(std::size_t k, const Moments& moments);

  std::size_t used = 0;  ///< how many of the kSize are asked for
  Values count{};
  std::array<Values, 3> sum{};
  std::array<Values, 6> products{};

  /// Zero where the points do not span a plane: fewer than 3, or all on one line.
  std::array<Values, 3> normal{};
  std::array<Values, 3> mean{};
  Values variance_across{};  ///< along the normal
  Values variance_within{};  ///< the smaller one in the plane
};

void fit_planes(PlaneBatch& batch);

}  // namespace cellmap::simd
