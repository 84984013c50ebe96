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
  explicit CodedIndex(const CodingLattice& lattice)
      : has_plane(lattice.lattice.size()), seen(lattice.places) {}

  std::vector<std::uint8_t> has_plane;  ///< by lattice index; an encoder's alone
  std::vector<std::uint8_t> seen;       ///< by place, of what is coded
  std::vector<std::uint32_t> of_layer;  ///< lattice indices of the layer coded last
  std::vector<std::uint8_t> was_any;    ///< whether the layer before has any, by block
};

/// Codes for each lattice point of a layer whether it has a plane: `has_plane` has a byte of 0 or 1
/// for each. About 0.14 bytes a plane.
template <typename Coder>
void code_index(Coder& coder, IndexModel& model, CodingLattice& lattice, int layer,
                CodedIndex& index) {
  constexpr std::uint32_t kBlock = 64;
  constexpr bool is_decoder = std::is_same_v<Coder, RangeDecoder>;
  std::vector<std::uint8_t> any_in;  // by block
  index.of_layer.clear();
  for (std::size_t s = 0; s < lattice.spheres.size(); ++s) {
    const LatticeSphere& sphere = lattice.spheres[s];
    const std::uint8_t* const values = index.has_plane.data() + sphere.first;
    std::uint8_t* const seen = index.seen.data() + lattice.first_place[s];
    bool any = false;
    for (std::uint32_t begin = 0; begin < sphere.count; begin += kBlock) {
      const std::uint32_t end = std::min(begin + kBlock, sphere.count);
      bool now = false;
      for (std::uint32_t k = is_decoder ? end : begin; k < end; ++k) {
        now |= values[k] != 0 && layer_of(sphere.point(k)) == layer;
      }
      const bool before = !index.was_any.empty() && index.was_any[any_in.size()];
      any = coder.bit(model.block[2 * any + before], now);
      any_in.push_back(any);
      for (std::uint32_t k = any ? begin : end; k < end; ++k) {
        const std::uint32_t point = sphere.point(k);
        if (layer_of(point) != layer) continue;
        std::uint32_t context = 0;
        for (const std::int32_t offset : lattice.belts[s].offsets_at(point)) {
          context = context << 1 | seen[static_cast<std::ptrdiff_t>(point) + offset];
        }
        if (!coder.bit(model.member[context], values[k] != 0)) continue;
        seen[point] = 1;
        index.of_layer.push_back(sphere.first + k);
      }
    }
  }
  index.was_any = std::move(any_in);
}

/// Throws Error{kCorruptData} unless there are `count`.
void check_count(const std::vector<std::uint32_t>& indices, std::size_t count);

}  // namespace cellmap
