#pragma once

#include <span>

#include "cellmap/codec/compact_planes.hpp"

namespace cellmap {

/// The index and the planes of a CELL, coded without loss (FORMAT.md, "Packed planes"): each of a
/// plane's four numbers as its distance, counted in floats, from what the planes around it predict;
/// or all bytes shuffled and compressed, where that is smaller. 11 to 12 bytes a
/// plane on real CELLs.
Bytes encode_packed_planes(const LatticeSpec& lattice, std::span<const std::uint32_t> indices,
                           std::span<const Plane> planes);

/// Trusts no byte, as `decode_compact_planes`. Numbers may be of any kind: the caller asks
/// `validate_planes`.
DecodedPlanes decode_packed_planes(const LatticeSpec& lattice, std::size_t count,
                                   std::span<const std::byte> bytes);

}  // namespace cellmap
