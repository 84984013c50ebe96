#pragma once

#include <span>

#include "cellmap/codec/plane_layers.hpp"

namespace cellmap {

/// The index and the planes of a CELL, coded without loss (FORMAT.md, "Packed planes"): each of a
/// plane's four numbers as its distance, counted in floats, from what the planes around it predict;
/// or all bytes of a layer shuffled and compressed, where that is smaller. 11 to 12 bytes a plane
/// on real CELLs.
CodedLayers encode_packed_planes(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                                 std::span<const Plane> planes);

/// Trusts no byte, as `decode_compact_planes`, and validates each plane.
DecodedPlanes decode_packed_planes(CodingLattice& lattice, std::span<const LayerView> layers);

}  // namespace cellmap
