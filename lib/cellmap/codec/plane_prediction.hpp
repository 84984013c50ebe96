#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/lattice_belts.hpp"

namespace cellmap {

// A plane as inverse range. With its unit normal n (towards the origin) and a point p on it, the
// vector m = n / (n . p) gives the range along any direction v as 1 / (m . v). So m is the same
// for all patches of one wall, and a patch's neighbours on the wall predict its plane exactly.
//
// Everything that a decoder predicts with is integers so small that their products are exact in
// double precision too: the same on every machine and in every language (FORMAT.md, "Predicted
// planes").

constexpr int kInverseRangeBits = 28;  ///< unit of m: 2^-28 per metre
constexpr double kInverseRangeUnit = 0x1p28;
constexpr int kDirectionBits = 20;                                ///< unit of directions: 2^-20
constexpr std::int64_t kMaxInverseRange = std::int64_t{1} << 30;  ///< of each coordinate: 4 per m

/// The largest integer that is not larger, of numbers that are small enough; without SSE 4.1
/// std::floor is a call.
inline std::int64_t floor_of(double x) {
  const auto truncated = static_cast<std::int64_t>(x);
  return truncated - (static_cast<double>(truncated) > x);
}

/// m in the CELL's frame, in units of 2^-28 per metre.
struct InversePlane {
  std::int64_t x = 0, y = 0, z = 0;
};

/// m in the frame of a patch: w = m . u is the inverse range at its centre, s1 and s2 are the
/// slopes of the inverse range along its tangents.
struct PatchPlane {
  std::int64_t w = 0, s1 = 0, s2 = 0;
  bool is_in_range() const {
    // One comparison each, and no branch between them.
    const auto is_small = [](std::int64_t v) {
      return static_cast<std::uint64_t>(v + kMaxInverseRange - 1) <
             2 * static_cast<std::uint64_t>(kMaxInverseRange) - 1;
    };
    return (w > 0) & is_small(w) & is_small(s1) & is_small(s2);
  }
};

/// The direction u of a patch and two tangents, t1 horizontal and t2 = u x t1.
struct PatchFrame {
  Eigen::Vector3d direction;
  std::array<std::array<double, 3>, 2> tangents;
  std::array<std::int64_t, 3> u, t1, t2;  ///< in units of 2^-20

  explicit PatchFrame(const Eigen::Vector3d& direction);
  PatchPlane to_patch(const InversePlane& m) const;
  InversePlane to_cell(const PatchPlane& plane) const;
};

/// What the planes around a patch say about its own.
struct PlanePrediction {
  PatchPlane plane;           ///< mean of those that agree
  int neighbours = 0;         ///< 0: none, and `plane` is a guess
  int agreeing = 0;           ///< 1 to `neighbours`
  std::int64_t w_spread = 0;  ///< sum over those that agree of how far each is from the mean
  std::int64_t s_spread = 0;  ///< the same of both slopes
};

/// The planes of a CELL that are already known, by place in the lattice.
class KnownPlanes {
 public:
  /// `lattice` must outlive it.
  KnownPlanes(CodingLattice& lattice, std::size_t planes);

  /// Which patch is coded next.
  void move_to(std::size_t sphere, std::uint32_t point);

  PlanePrediction predict(const PatchFrame& frame);

  /// Makes the present patch a neighbour of later ones.
  void add(const InversePlane& m);

 private:
  static constexpr std::size_t kUsed = 6;  ///< of the neighbours

  CodingLattice& lattice_;
  std::size_t sphere_ = 0;
  std::uint32_t point_ = 0;
  std::vector<std::uint32_t> slots_;  ///< by place: position in planes_, 0: none
  std::vector<InversePlane> planes_;
};

}  // namespace cellmap
