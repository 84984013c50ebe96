#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {

/// The index and the planes of a CELL, coded with a bound (FORMAT.md, "Compact planes"): no point
/// of a plane within its patch moves by more than `bound_m` along the plane's normal, as
/// `plane_displacement_m` measures it. Planes that no step serves, because they graze their patch
/// or pass very near the origin, are kept as they are.
Bytes encode_compact_planes(const LatticeSpec& lattice, std::span<const std::uint32_t> indices,
                            std::span<const Plane> planes, double bound_m);

struct DecodedPlanes {
  std::vector<std::uint32_t> indices;
  std::vector<Plane> planes;
};

/// Trusts no byte: Error{kCorruptData} for any that no encoder writes for `count` planes. The
/// planes are finite; the caller asks `validate_planes`. Time and memory are bounded by the
/// lattice: at most 20 bytes a lattice point.
DecodedPlanes decode_compact_planes(const LatticeSpec& lattice, std::size_t count,
                                    std::span<const std::byte> bytes, double bound_m);

}  // namespace cellmap
