#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/codec/archive_layout.hpp"

namespace cellmap {

/// Where a record is, its header included. In the root of an archive with leaves: where a leaf
/// directory is, `cell` the first of its CELLs.
struct ArchiveEntry {
  CellId cell;
  std::uint64_t offset = 0;    ///< a multiple of 8
  std::uint32_t bytes = 0;     ///< unpadded
  std::uint64_t checksum = 0;  ///< of a leaf; 0 for a CELL, whose record has its own
  bool operator==(const ArchiveEntry&) const = default;

  std::uint64_t end() const { return aligned_up(offset + bytes); }
};

/// A zstd frame; 2 to 3 bytes a CELL. Entries have increasing ids and offsets, the first not before
/// `begin`, and do not overlap.
Bytes encode_archive_directory(std::span<const ArchiveEntry> entries, std::uint64_t begin,
                               bool of_leaves);

/// Trusts no byte. Throws Error{kCorruptData} where the rules above do not hold or an entry ends
/// behind `end`.
std::vector<ArchiveEntry> decode_archive_directory(std::span<const std::byte> bytes,
                                                   std::uint64_t begin, std::uint64_t end,
                                                   bool of_leaves);

}  // namespace cellmap
