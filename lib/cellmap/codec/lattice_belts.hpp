#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "cellmap/codec/coding_memory.hpp"
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

  std::uint32_t end() const { return first + count; }
  std::uint32_t point(std::uint32_t k) const { return points.empty() ? k : points[k]; }
  double patch_radius_rad() const;
};

/// In the order of the lattice's indices. Linear in its size for bands, else constant.
std::vector<LatticeSphere> spheres_of(const Lattice& lattice);

/// A CELL's patches in the order in which they are coded: first the coarse layer, which is every
/// fourth point of a sphere, then the fine one, all others; in each by lattice index.
constexpr int kPlaneLayers = 2;
constexpr std::uint32_t kCoarsePoints = 4;
constexpr int layer_of(std::uint32_t point) { return point % kCoarsePoints != 0; }

/// Which points of a sphere are coded before a point and lie nearest to it: along a belt of
/// latitude always the same differences of index, because a Fibonacci sphere is, in (index,
/// azimuth), a plane lattice whose short vectors are few. FORMAT.md, "Neighbours".
class LatticeBelts {
 public:
  static constexpr std::size_t kNeighbours = 8;
  /// Neighbour n of point p is p + offset n, nearest first; there may be no such point.
  using Offsets = std::array<std::int32_t, kNeighbours>;

  explicit LatticeBelts(const LatticeSphere& sphere);

  /// What is the same for points of a belt that have the same place among the coarse ones.
  struct Neighbourhood {
    Offsets offsets;
    std::uint32_t least_step;  ///< to the nearest of those before it in its own layer
  };

  /// A belt has 256 points; what is found for one of them is kept for all.
  const Neighbourhood& at(std::uint32_t point) {
    Belt& belt = belts_[point / kBeltPoints];
    if (!belt.is_known) enter(belt, point / kBeltPoints);
    return belt.of[point % kCoarsePoints];
  }
  const Offsets& offsets_at(std::uint32_t point) { return at(point).offsets; }

  /// No offset is larger.
  std::uint32_t margin() const { return margin_; }

 private:
  static constexpr std::uint32_t kBeltPoints = 256;
  struct Candidate {
    std::uint32_t step;
    double azimuth2_rad2;  ///< from a point to the one so many before it, or back, squared
    double height2;        ///< the same of their heights on the unit sphere

    /// On the belt whose circle has the squared radius r2.
    double distance2(double r2) const { return azimuth2_rad2 * r2 + height2 / r2; }
  };
  struct Belt {
    bool is_known = false;
    std::array<Neighbourhood, kCoarsePoints> of;  ///< by point % kCoarsePoints
  };
  using Steps = std::array<std::uint32_t, kNeighbours>;

  using Places = std::array<std::uint32_t, kNeighbours>;  ///< among candidates

  /// The nearest first. `nearest` are any eight, best those of a belt beside it, and become these.
  static Steps nearest_steps(const std::vector<Candidate>& candidates, double r2, Places& nearest);
  void enter(Belt& belt, std::uint32_t number);

  std::uint32_t size_, divisor_, offset_, margin_;
  std::vector<Candidate> fine_, coarse_;  ///< increasing steps
  Places nearest_fine_ = {0, 1, 2, 3, 4, 5, 6, 7}, nearest_coarse_ = nearest_fine_;
  std::vector<Belt> belts_;
};

/// The points of a lattice with what is known of their neighbours, and a place in one array for
/// each point of each sphere, with room on both sides for neighbours that are not there. For one
/// coder at a time, which uses its memory.
struct CodingLattice {
  explicit CodingLattice(const LatticeSpec& spec);

  Lattice lattice;
  std::vector<LatticeSphere> spheres;
  std::vector<LatticeBelts> belts;       ///< of each sphere
  std::vector<std::size_t> first_place;  ///< of point 0 of each sphere
  std::size_t places = 0;
  CodingMemory memory;
};

}  // namespace cellmap
