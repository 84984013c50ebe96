#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/client/json.hpp"

namespace cellmap::cli {

/// How two archives differ, by their lists of CELLs and poses: no CELL is read.
struct ArchiveDifference {
  std::uint64_t alike = 0;      ///< CELLs of the same id and raw hash
  std::vector<CellId> added;    ///< only in the second
  std::vector<CellId> removed;  ///< only in the first
  std::vector<CellId> changed;  ///< of the same id, with another raw hash
  std::uint64_t moved = 0;      ///< of those in both, by more than 0.2 mm or 2e-6 rad
  double farthest_m = 0, largest_turn_rad = 0;
  std::array<std::size_t, 2> constraints{};
  std::array<Revision, 2> revisions{};
};
ArchiveDifference difference(ArchiveReader& a, ArchiveReader& b);

client::Json to_json(const ArchiveDifference& difference);

}  // namespace cellmap::cli
