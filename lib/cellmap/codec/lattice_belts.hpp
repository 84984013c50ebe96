#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "cellmap/geometry/lattice.hpp"

namespace cellmap {

/// A stretch of a lattice's indices whose directions are points of one whole Fibonacci sphere, in
/// its order; 1 in a lattice of kind kFibonacci, 3 in one of bands.
struct LatticeSphere {
  std::uint32_t size = 0;             ///< points of the whole sphere
  std::uint32_t divisor = 0;          ///< M and o of FORMAT.md, "Lattices": point i has the height
  std::uint32_t offset = 0;           ///< (M - a) / M, a = 2 i + o
  std::uint32_t first = 0;            ///< lattice index of its first point that is there
  std::vector<std::uint32_t> points;  ///< of index first + k; empty: all, point k
  std::uint32_t count = 0;            ///< of indices

  std::uint32_t point(std::uint32_t k) const { return points.empty() ? k : points[k]; }
  double patch_radius_rad() const;
};

/// In the order of the lattice's indices. Linear in its size for bands, else constant.
std::vector<LatticeSphere> spheres_of(const Lattice& lattice);

/// Which points of a sphere that come earlier in its order lie nearest to a point: along a belt of
/// latitude always the same differences of index, because a Fibonacci sphere is, in (index,
/// azimuth), a plane lattice whose short vectors are few. FORMAT.md, "Neighbours".
class LatticeBelts {
 public:
  static constexpr std::size_t kNeighbours = 8;
  using Steps = std::array<std::uint32_t, kNeighbours>;

  explicit LatticeBelts(const LatticeSphere& sphere);

  /// Neighbour n of point p is p - steps_at(p)[n], nearest first; there may be no such point.
  /// Almost always as cheap as a comparison: a belt has 256 points.
  const Steps& steps_at(std::uint32_t point) {
    if (point / kBeltPoints != belt_) enter(point / kBeltPoints);
    return steps_;
  }

  /// No step is larger.
  std::uint32_t largest_step() const { return candidates_.back().step; }

 private:
  static constexpr std::uint32_t kBeltPoints = 256;
  struct Candidate {
    std::uint32_t step;
    double azimuth_rad;  ///< from a point to the one so many before it, or back
  };

  void enter(std::uint32_t belt);

  std::uint32_t size_, divisor_, offset_;
  std::vector<Candidate> candidates_;  ///< increasing steps
  std::uint32_t belt_ = 0xffffffff;
  Steps steps_{};
};

}  // namespace cellmap
