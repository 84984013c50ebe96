#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/lattice_belts.hpp"
#include "cellmap/simd/patch_planes.hpp"

namespace cellmap {

// A plane as inverse range. With its unit normal n (towards the origin) and a point p on it, the
// vector m = n / (n . p) gives the range along any direction v as 1 / (m . v). So m is the same
// for all patches of one wall, and a patch's neighbours on the wall predict its plane exactly.
//
// Everything that a decoder predicts with is integers so small that their products are exact in
// double precision too: the same on every machine and in every language (FORMAT.md, "Predicted
// planes").

constexpr double kInverseRangeUnit = 0x1p28;  ///< unit of m: 2^-28 per metre
constexpr double kMaxInverseRange = 0x1p30;   ///< of each coordinate: 4 per m

/// Patches that are coded one after another and of which none is another's neighbour. So all of
/// them are predicted before the first is coded, side by side.
struct PatchBatch {
  std::size_t count = 0;                                   ///< at most simd::kMostPatches
  std::size_t sphere = 0;                                  ///< that all of them are of
  std::array<std::uint32_t, simd::kMostPatches> points{};  ///< of the sphere, ascending
  simd::PatchFrames frames;

  Eigen::Vector3d direction(std::size_t k) const {
    return {frames.u[0][k], frames.u[1][k], frames.u[2][k]};
  }
};

/// Calls `use(k, batch)` for batches of lattice points, which ascend and are of one layer; `k` is
/// the position of the batch's first one.
template <typename Use>
void visit_batches(CodingLattice& lattice, std::span<const std::uint32_t> indices, const Use& use) {
  PatchBatch batch;
  for (std::size_t begin = 0; begin < indices.size(); begin += batch.count) {
    const std::uint32_t first = indices[begin];
    while (first >= lattice.spheres[batch.sphere].end()) ++batch.sphere;
    const LatticeSphere& sphere = lattice.spheres[batch.sphere];
    LatticeBelts& belts = lattice.belts[batch.sphere];
    const std::size_t most = std::min(simd::kMostPatches, indices.size() - begin);
    for (batch.count = 0; batch.count < most && indices[begin + batch.count] < sphere.end();
         ++batch.count) {
      const std::uint32_t point = sphere.point(indices[begin + batch.count] - sphere.first);
      batch.points[batch.count] = point;
      if (point - batch.points[0] >= belts.at(point).least_step) break;
    }
    const auto part = indices.subspan(begin, batch.count);
    lattice.lattice.directions(part, batch.frames.u[0].data(), batch.frames.u[1].data(),
                               batch.frames.u[2].data());
    simd::complete_frames(batch.frames, batch.count);
    use(begin, batch);
  }
}

/// What is expected of a patch from the planes around it that agree.
enum class PredictionRule {
  kMean,    ///< their mean
  kFitted,  ///< the plane through their centres
};

/// The planes of a CELL that are already known, by place in the lattice.
class KnownPlanes {
 public:
  /// For at most `planes` that are added. `lattice` must outlive it, and another one of it makes it
  /// void.
  KnownPlanes(CodingLattice& lattice, std::size_t planes,
              PredictionRule rule = PredictionRule::kMean);

  /// What is known around each patch of `batch`.
  const simd::PatchPredictions& predict(const PatchBatch& batch);

  /// Whether there is nothing around patch k of the batch predicted last. Then `guess` predicts it
  /// from the plane that was added last.
  bool is_guess(std::size_t k) const { return predictions_.neighbours[k] == 0; }
  void guess(const PatchBatch& batch, std::size_t k);

  /// Makes patch k of the batch a neighbour of later ones.
  void add(const PatchBatch& batch, std::size_t k, const InversePlane& m) {
    const std::uint32_t slot = used_slots_++;
    memory_.slots[place(batch, k)] = static_cast<std::uint16_t>(slot);
    if (has_high_slots_) {
      memory_.high_slots[place(batch, k)] = static_cast<std::uint8_t>(slot >> 16);
    }
    const simd::PatchVectors& u = batch.frames.u;
    memory_.known[slot] = {m.x, m.y, m.z, u[0][k], u[1][k], u[2][k]};
  }

 private:
  /// Fills `around_`.
  template <bool kHasHighSlots>
  void look_around(const PatchBatch& batch);
  std::size_t place(const PatchBatch& batch, std::size_t k) const {
    return lattice_.first_place[batch.sphere] + batch.points[k];
  }

  CodingLattice& lattice_;
  CodingMemory& memory_;
  std::uint32_t used_slots_ = 1;  ///< of `known`
  bool has_high_slots_;
  PredictionRule rule_;
  simd::PatchNeighbours around_;
  simd::PatchPredictions predictions_;
};

}  // namespace cellmap
