#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

#include "cellmap/codec/lattice_belts.hpp"
#include "cellmap/codec/range_coder.hpp"

namespace cellmap {

/// Models of which lattice points have a plane (FORMAT.md, "Coded index").
struct IndexModel {
  std::array<BitModel, 4> block;     ///< by whether the block before and the coarse layer have one
  std::array<BitModel, 256> member;  ///< by which of the eight neighbours have one
};

/// Which points of a lattice have a plane, as far as it is known.
struct CodedIndex {
  explicit CodedIndex(CodingLattice& lattice) : seen(lattice.memory.seen) {
    seen.assign(lattice.places, 0);
  }

  std::vector<std::uint8_t> has_plane;  ///< by lattice index, 0 or 1; an encoder's alone
  std::vector<std::uint8_t>& seen;      ///< by place, of what is coded
  std::vector<std::uint32_t> of_layer;  ///< lattice indices of the layer coded last
  std::vector<std::uint8_t> was_any;    ///< whether the layer before has any, by block
};

constexpr std::uint32_t kIndexBlock = 64;  ///< lattice points

/// For points of a block: a bit for each neighbour, the nearest one's highest, whether it has a
/// plane.
class IndexContexts {
 public:
  /// `seen` by place, from point 0 of `sphere` on.
  IndexContexts(const LatticeSphere& sphere, LatticeBelts& belts, const std::uint8_t* seen)
      : sphere_(sphere), belts_(belts), seen_(seen) {}

  /// Makes out those of a whole block side by side where none of its points is another's neighbour,
  /// which is nearly everywhere.
  void enter(std::uint32_t begin, int layer);

  std::uint8_t of(std::uint32_t k, std::uint32_t point) const {
    return is_whole_ ? of_block_[point % kCoarsePoints][k % kIndexBlock] : single(point);
  }

 private:
  std::uint8_t single(std::uint32_t point) const;

  const LatticeSphere& sphere_;
  LatticeBelts& belts_;
  const std::uint8_t* seen_;
  bool is_whole_ = false;
  std::array<std::array<std::uint8_t, kIndexBlock>, kCoarsePoints> of_block_;
};

/// Codes for each lattice point of a layer whether it has a plane: `has_plane` has a byte of 0 or 1
/// for each. About 0.14 bytes a plane.
template <typename Coder>
void code_index(Coder& shared_coder, IndexModel& model, CodingLattice& lattice, int layer,
                CodedIndex& index) {
  constexpr bool is_decoder = std::is_same_v<Coder, RangeDecoder>;
  Coder coder = std::move(shared_coder);  // where nobody else sees it, so in registers
  std::vector<std::uint8_t> any_in;       // by block
  index.of_layer.clear();
  for (std::size_t s = 0; s < lattice.spheres.size(); ++s) {
    const LatticeSphere& sphere = lattice.spheres[s];
    const std::uint8_t* const values = is_decoder ? nullptr : index.has_plane.data() + sphere.first;
    std::uint8_t* const seen = index.seen.data() + lattice.first_place[s];
    IndexContexts contexts(sphere, lattice.belts[s], seen);
    bool any = false;
    for (std::uint32_t begin = 0; begin < sphere.count; begin += kIndexBlock) {
      const std::uint32_t end = std::min(begin + kIndexBlock, sphere.count);
      bool now = false;
      for (std::uint32_t k = is_decoder ? end : begin; k < end; ++k) {
        now |= values[k] != 0 && layer_of(sphere.point(k)) == layer;
      }
      const bool before = !index.was_any.empty() && index.was_any[any_in.size()];
      any = coder.bit(model.block[2 * any + before], now);
      any_in.push_back(any);
      if (!any) continue;
      contexts.enter(begin, layer);
      for (std::uint32_t k = begin; k < end; ++k) {
        const std::uint32_t point = sphere.point(k);
        if (layer_of(point) != layer) continue;
        const bool value = !is_decoder && values[k] != 0;
        if (!coder.bit(model.member[contexts.of(k, point)], value)) continue;
        seen[point] = 1;
        index.of_layer.push_back(sphere.first + k);
      }
    }
  }
  index.was_any = std::move(any_in);
  shared_coder = std::move(coder);
}

/// Throws Error{kCorruptData} unless there are `count`.
void check_count(const std::vector<std::uint32_t>& indices, std::size_t count);

}  // namespace cellmap
