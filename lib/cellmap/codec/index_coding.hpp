#pragma once

#include <algorithm>
#include <array>
#include <bit>
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
  /// which is nearly everywhere. Else returns false.
  bool enter(std::uint32_t begin, int layer);

  /// Of point k of the block that was entered.
  std::uint8_t of_entered(int k) const { return of_block_[k % kCoarsePoints][k]; }
  std::uint8_t of(std::uint32_t point) const;

 private:
  const LatticeSphere& sphere_;
  LatticeBelts& belts_;
  const std::uint8_t* seen_;
  std::array<std::array<std::uint8_t, kIndexBlock>, kCoarsePoints> of_block_;
};

/// Calls `use(k)` for each bit k, ascending.
template <typename Use>
[[gnu::always_inline]] inline void visit_bits(std::uint64_t bits, const Use& use) {
  for (; bits != 0; bits &= bits - 1) use(std::countr_zero(bits));
}

/// Which points of the block that begins at `begin` are of a layer, a bit each.
std::uint64_t points_in_layer(const LatticeSphere& sphere, std::uint32_t begin, int layer);

/// Which of `points` have a plane: `members`, which a decoder reads. `context_of(k)` is asked after
/// `found(j)` was called for every j < k that has one.
template <typename Coder, typename ContextOf, typename Found>
[[gnu::always_inline]] inline std::uint64_t code_members(Coder& coder, IndexModel& model,
                                                         std::uint64_t points,
                                                         std::uint64_t members,
                                                         const ContextOf& context_of,
                                                         const Found& found) {
  std::uint64_t read = 0;
  visit_bits(points, [&](int k) {
    if (!coder.bit(model.member[context_of(k)], members >> k & 1)) return;
    read |= std::uint64_t{1} << k;
    found(k);
  });
  return read;
}

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
    std::uint8_t* const seen = index.seen.data() + lattice.first_place[s];
    IndexContexts contexts(sphere, lattice.belts[s], seen);
    bool any = false;
    for (std::uint32_t begin = 0; begin < sphere.count; begin += kIndexBlock) {
      const std::uint64_t points = points_in_layer(sphere, begin, layer);
      std::uint64_t members = 0;
      if constexpr (!is_decoder) {
        visit_bits(points, [&](int k) {
          members |= std::uint64_t{index.has_plane[sphere.first + begin + k]} << k;
        });
      }
      const bool before = !index.was_any.empty() && index.was_any[any_in.size()];
      any = coder.bit(model.block[2 * any + before], members != 0);
      any_in.push_back(any);
      if (!any) continue;
      if (contexts.enter(begin, layer)) {
        members = code_members(
            coder, model, points, members, [&](int k) { return contexts.of_entered(k); },
            [](int) {});
      } else {
        members = code_members(
            coder, model, points, members,
            [&](int k) { return contexts.of(sphere.point(begin + k)); },
            [&](int k) { seen[sphere.point(begin + k)] = 1; });
      }
      visit_bits(members, [&](int k) {
        seen[sphere.point(begin + k)] = 1;
        index.of_layer.push_back(sphere.first + begin + k);
      });
    }
  }
  index.was_any = std::move(any_in);
  shared_coder = std::move(coder);
}

/// Throws Error{kCorruptData} unless there are `count`.
void check_count(const std::vector<std::uint32_t>& indices, std::size_t count);

}  // namespace cellmap
