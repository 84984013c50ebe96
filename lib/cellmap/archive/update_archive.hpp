#pragma once

#include <cstdint>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/byte_source.hpp"

namespace cellmap {

/// Brings poses and constraints of an archive to those of `graph`, a later revision of the same
/// map, by appending: nothing that is there moves, and until the last write, which is of 64 bytes,
/// readers find the state before. Wherever this is cut off, the archive is readable in one of the
/// two states. Poses that changed are kept on the grid of pose_grid.hpp, within 0.11 mm and 8.3e-7
/// rad; about 13 bytes a CELL are written. Returns how many bytes were written.
///
/// Throws Error{kConflict} where the graph has other CELLs, or is of another map or an earlier
/// revision: archive the map anew. One writer at a time.
std::uint64_t update_archive(ByteFile& file, const PoseGraph& graph);

}  // namespace cellmap
