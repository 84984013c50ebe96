#pragma once

#include <span>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/pose_graph/map_changes.hpp"

namespace cellmap {

/// Limit of encoded changes: a million CELLs added with their constraints.
constexpr std::size_t kMaxChangesBytes = 512u << 20;
/// Of moved CELLs, and of each list of ids. They can be as short as a byte each on their way, so
/// that a limit of bytes alone would not bound the memory that they take.
constexpr std::size_t kMaxIdsInChanges = 1u << 21;

/// schema/changes.fbs, identifier "CCHG", for thin links: all but the poses of `moved` comes back
/// to the bit; those come back as `from_grid(to_grid(pose))` (pose_grid.hpp), within 0.11 mm and
/// 8.3e-7 rad. Deterministic. After a loop that moves a whole map about 19 bytes a CELL, 13 after
/// zstd. Throws Error{kCorruptData} for changes that `decode_changes` would refuse.
Bytes encode_changes(const MapChanges& changes);

/// Trusts no byte: verifies, then checks the rules of FORMAT.md, "Changes". Throws as
/// `decode_pose_graph` does, with the limit `kMaxChangesBytes`.
MapChanges decode_changes(std::span<const std::byte> bytes);

}  // namespace cellmap
