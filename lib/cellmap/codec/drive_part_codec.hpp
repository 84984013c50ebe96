#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/geometry/voxel_grid.hpp"

namespace cellmap {

/// What one worker tells another of a CELL that it made for it: all but the points of its base
/// scan, which are quickly read again and larger than all the rest.
struct MadeCell {
  std::shared_ptr<const Cell> cell;
  std::vector<ScanInCell> scans;   ///< one or more
  std::uint64_t raw_points = 0;    ///< of its scans before filtering
  std::vector<VoxelBlock> voxels;  ///< that its scans hit, by key
};

constexpr std::size_t kMaxDrivePartCells = 64;
constexpr std::size_t kMaxDrivePartBytes = 64u << 20;

/// CELLs as a FlatBuffers buffer (schema/drive_part.fbs, identifier "CPRT"), without loss. Throws
/// Error{kTooLarge} over a limit, and what `encode_cell` throws.
Bytes encode_drive_part(std::span<const MadeCell> cells);

/// Trusts no byte: throws Error{kCorruptData}, {kTooLarge} over a limit, {kUnsupported} for another
/// version. Whether these are the CELLs that were asked for is the caller's to see.
std::vector<MadeCell> decode_drive_part(std::span<const std::byte> bytes);

}  // namespace cellmap
