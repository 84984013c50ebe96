#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "cellmap/codec/lattice_belts.hpp"
#include "cellmap/codec/range_coder.hpp"

namespace cellmap {

/// Models of which lattice points have a plane (FORMAT.md, "Coded index").
struct IndexModel {
  std::array<BitModel, 4> block;     ///< by whether each of the last two blocks has one
  std::array<BitModel, 256> member;  ///< by which of the eight nearest earlier points have one
};

/// Codes for each lattice point whether it has a plane: `has_plane` has a byte of 0 or 1 for each,
/// which is read by an encoder and written by a decoder. About 0.14 bytes a plane.
template <typename Coder>
void code_index(Coder& coder, IndexModel& model, const std::vector<LatticeSphere>& spheres,
                std::vector<std::uint8_t>& has_plane) {
  constexpr std::uint32_t kBlock = 64;
  for (const LatticeSphere& sphere : spheres) {
    LatticeBelts belts(sphere);
    const std::uint32_t before = belts.largest_step();  // so that no neighbour needs a test
    std::vector<std::uint8_t> seen(before + sphere.size);
    std::uint32_t history = 0;
    for (std::uint32_t begin = 0; begin < sphere.count; begin += kBlock) {
      const std::uint32_t end = std::min(begin + kBlock, sphere.count);
      std::uint8_t* const values = has_plane.data() + sphere.first;
      bool any = std::find(values + begin, values + end, 1) != values + end;
      any = coder.bit(model.block[history & 3], any);
      history = history << 1 | std::uint32_t{any};
      for (std::uint32_t k = any ? begin : end; k < end; ++k) {
        const std::uint32_t at = before + sphere.point(k);
        std::uint32_t context = 0;
        for (const std::uint32_t step : belts.steps_at(sphere.point(k))) {
          context = context << 1 | seen[at - step];
        }
        values[k] = seen[at] = coder.bit(model.member[context], values[k] != 0);
      }
    }
  }
}

/// The lattice points that have a plane. Throws Error{kCorruptData} unless there are `count`.
std::vector<std::uint32_t> indices_of(const std::vector<std::uint8_t>& has_plane,
                                      std::size_t count);

}  // namespace cellmap
