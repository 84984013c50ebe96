#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "cellmap/codec/archive_layout.hpp"
#include "cellmap/core/hash.hpp"
#include "cellmap/pipeline/refine.hpp"

namespace cellmap {

/// What an archive's list says of a CELL, so that lists and comparisons need no CELL bytes.
struct ArchivedCell {
  CellId id;
  ContentHash hash;  ///< of the CELL that was archived, as `encode_cell` has it: its raw hash
  std::uint32_t session = 0;  ///< place in `ArchiveFooter::sessions`
  std::uint32_t sequence = 0;
  std::uint32_t planes = 0;
  std::uint64_t bytes = 0;  ///< as `encode_cell` writes it
  bool operator==(const ArchivedCell&) const = default;
};

/// Limit of each section, as FlatBuffers.
constexpr std::size_t kMaxArchiveSectionBytes = 512u << 20;

/// schema/archive.fbs, identifier "CACL"; ids strictly increase. About 34 bytes a CELL with zstd.
Bytes encode_archive_cells(std::span<const ArchivedCell> cells);
/// Trusts no byte. Throws Error{kCorruptData}, also where a session is not below `sessions`.
std::vector<ArchivedCell> decode_archive_cells(std::span<const std::byte> bytes,
                                               std::size_t sessions);

/// schema/archive.fbs, identifier "CASC": the stretches of all drives by id of CELL. `exact`: every
/// bit of the poses, else on the grid of pose_grid.hpp: within 0.11 mm and 8.3e-7 rad, in a tenth
/// of the bytes.
Bytes encode_archive_scans(const std::map<CellId, CellScans>& stretches, bool exact);
/// Trusts no byte. Throws Error{kCorruptData}, {kTooLarge}.
std::map<CellId, CellScans> decode_archive_scans(std::span<const std::byte> bytes);

}  // namespace cellmap
