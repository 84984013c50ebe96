#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "cellmap/archive/archive_reader.hpp"

namespace cellmap {

/// What is wrong with an archive, or noteworthy.
struct ArchiveReport {
  std::vector<std::string> damage;  ///< one sentence each; empty: every byte is as it was written
  std::vector<CellId> lost;         ///< CELLs of the directory that cannot be read
  std::uint64_t bytes = 0;          ///< of the file
  std::uint64_t cells = 0;          ///< that are intact
  std::uint64_t planes = 0;         ///< of those
};

/// Looks at every byte: checksums, formats, limits, that parts lie where others say and that what
/// lies between them is zero, and each CELL against the list of CELLs. Damage is an answer, not an
/// exception: throws only what the source throws. `on_cell` is called for each intact CELL, by id.
/// A few MB in memory beside the sections.
ArchiveReport verify_archive(ByteSource& source,
                             const std::function<void(const ArchiveCell&)>& on_cell = {});

}  // namespace cellmap
