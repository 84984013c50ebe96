#pragma once

#include <span>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/schema/cell_generated.h"

namespace cellmap {

// What a CELL's encodings have in common on the wire.

LatticeSpec lattice_from_wire(const schema::Lattice& wire);
flatbuffers::Offset<schema::Lattice> lattice_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                                     const LatticeSpec& spec);

CellStatistics statistics_from_wire(const schema::Statistics* wire);
flatbuffers::Offset<schema::Statistics> statistics_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                                           const CellStatistics& statistics);

ContentHash hash_from_wire(const schema::Hash256& wire);
schema::Hash256 hash_to_wire(const ContentHash& hash);

/// Where among `bytes` a hash of theirs is.
std::size_t offset_of(std::span<const std::byte> bytes, const schema::Hash256& hash);

/// SHA-256 of `bytes` with zeros in place of `claimed`, a hash among them, which it must be: else
/// throws Error{kCorruptData} naming `kind`.
ContentHash check_hash(std::span<const std::byte> bytes, const schema::Hash256& claimed,
                       const char* kind);

/// Writes that hash where `place`, among the bytes, is.
ContentHash write_hash(std::span<std::byte> bytes, const schema::Hash256& place);

/// The same of bytes with two hashes, both of which are taken as zeros. Error{kCorruptData} where
/// they overlap.
ContentHash hash_without(std::span<const std::byte> bytes, const schema::Hash256& first,
                         const schema::Hash256& second);

/// Writes that hash where `place`, the first of the two, is.
void write_hash_without(std::span<std::byte> bytes, const schema::Hash256& place,
                        const schema::Hash256& other);

/// Everything but indices and planes; `Wire` is the table of an encoding.
template <typename Wire>
Cell header_from_wire(const Wire& wire) {
  Cell cell;
  cell.lattice = lattice_from_wire(*wire.lattice());
  cell.session = wire.session()->str();
  cell.sequence = wire.sequence();
  cell.T_odom_cell = pose_from_wire(wire.t_odom_cell(), "the CELL's pose T_odom_cell");
  cell.first_stamp = wire.first_stamp_ns();
  cell.last_stamp = wire.last_stamp_ns();
  cell.first_scan = wire.first_scan();
  cell.scan_count = wire.scan_count();
  cell.statistics = statistics_from_wire(wire.statistics());
  return cell;
}

}  // namespace cellmap
