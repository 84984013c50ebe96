#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/simd/patch_planes.hpp"

namespace cellmap {

/// m of "A plane as inverse range" (plane_prediction.hpp) in the CELL's frame, whole numbers in
/// units of 2^-28 per metre.
struct InversePlane {
  double x = 0, y = 0, z = 0;
};

/// Ascending lattice indices and their planes.
struct DecodedPlanes {
  std::vector<std::uint32_t> indices;
  std::vector<Plane> planes;
};

/// What is filled anew for every CELL, kept from one to the next: fresh memory would cost a tenth
/// of decoding.
struct CodingMemory {
  // By place: position in `known`, 0: none. Two bytes, which are fetched sooner than four; a third
  // one where there are so many planes.
  std::vector<std::uint16_t> slots;
  std::vector<std::uint8_t> high_slots;
  std::vector<simd::PatchNeighbours::Numbers> known;
  std::vector<std::uint8_t> seen;  ///< by place, whether it has a plane
  std::array<DecodedPlanes, 2> layers;
};

}  // namespace cellmap
