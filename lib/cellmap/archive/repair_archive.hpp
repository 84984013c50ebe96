#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "cellmap/archive/byte_source.hpp"

namespace cellmap {

/// What was recovered from a damaged archive.
struct RepairReport {
  std::uint64_t cells = 0;          ///< recovered
  std::uint64_t cells_before = 0;   ///< as far as the archive still says; else `cells`
  std::uint64_t bytes_skipped = 0;  ///< among the records, that belong to no intact one
  std::vector<std::string> notes;   ///< what else was lost, and what took its place
};

/// Writes a new archive of everything that is intact in a damaged, cut off or unfinished one. CELLs
/// are found by their own headers, with or without the directory, and are copied as they are. Each
/// other part is taken where it is intact. Where the poses are lost, CELLs lie where the odometry
/// of their session had them; the sessions but the first are unaligned then. An intact archive
/// comes out without what updates left behind.
///
/// Throws Error{kCorruptData} where neither a CELL nor a footer is left, and what the files throw.
/// A few MB in memory, and about 100 bytes a CELL; decodes each CELL twice.
RepairReport repair_archive(ByteSource& damaged, ByteFile& repaired);

}  // namespace cellmap
