#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/codec/plane_layers.hpp"

namespace cellmap {

/// Of the coding. Both are read, the newer one is written.
enum class CompactVersion { k1 = 1, k2 = 2 };

/// The index and the planes of a CELL, coded with a bound (FORMAT.md, "Compact planes"): no point
/// of a plane within its patch moves by more than `bound_m` along the plane's normal, as
/// `plane_displacement_m` measures it. Planes that no step serves, because they graze their patch
/// or pass very near the origin, are kept as they are.
CodedLayers encode_compact_planes(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                                  std::span<const Plane> planes, double bound_m);

/// Trusts no byte: Error{kCorruptData} for any that no encoder writes for so many planes. One layer
/// gives the coarse planes, two give all. For each plane `validate_plane` holds.
/// Time and memory are bounded by the lattice: at most 40 bytes a lattice point.
DecodedPlanes decode_compact_planes(CodingLattice& lattice, std::span<const LayerView> layers,
                                    double bound_m, CompactVersion version);

/// How often a model's bit was 0 and 1.
using BitCounts = std::vector<std::array<std::uint64_t, 2>>;

/// Adds what coding a CELL asks of each model, in the order of the table of first probabilities
/// of version 2 (FORMAT.md, "First probabilities"), to `counts`, which grows to its size.
void count_compact_bits(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                        std::span<const Plane> planes, double bound_m, BitCounts& counts);

}  // namespace cellmap
