#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/archive/byte_source.hpp"
#include "cellmap/codec/archive_cells.hpp"
#include "cellmap/codec/archive_directory.hpp"
#include "cellmap/codec/archive_footer.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/kept_cell.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

struct ArchiveOptions {
  ArchiveEncoding encoding = ArchiveEncoding::kPacked;
  double bound_m = kDefaultCompactBoundM;  ///< of kCompact; see `encode_compact_cell`

  /// Throws Error{kInvalidArgument}.
  void validate() const;
};

/// What a map has beside its CELLs.
struct ArchiveContents {
  std::string map;
  Stamp created = 0;
  std::vector<ArchiveSession> sessions;
  std::optional<Georeference> georeference;
  PoseGraph graph;                        ///< its nodes are the CELLs that were added
  std::map<CellId, CellScans> stretches;  ///< of CELLs that have scans
};

/// Writes an archive CELL by CELL: one CELL in memory at a time, and about 100 bytes of each that
/// was written. Until `finish` the file says that it is not finished; `repair_archive` recovers
/// CELLs from it all the same.
class ArchiveWriter {
 public:
  /// `file` is empty and outlives the writer. Throws Error{kInvalidArgument}.
  ArchiveWriter(ByteFile& file, const LatticeSpec& lattice, const ArchiveOptions& options);

  /// The next CELL: ids increase, each has the archive's lattice; else Error{kInvalidArgument}. A
  /// CELL that cannot be coded is Error{kCorruptData}, and the archive goes on without it.
  void add(CellId id, const Cell& cell);
  /// The same for one as a store keeps it: coded bytes of the archive's own form are copied. A
  /// compact one is copied where its bound is no wider than the archive's, else Error{kConflict}:
  /// coded anew its errors would add up, and an exact form would hide them.
  void add(CellId id, const KeptCell& cell);
  /// The same for one that is coded already, as `ArchiveOptions` say: `cell` is what the payload
  /// decodes to.
  void add_payload(CellId id, const Cell& cell, const ContentHash& raw_hash,
                   std::span<const std::byte> payload);

  /// Writes directory, sections and footer, then the head. Compact archives keep the poses of
  /// scans on a grid (`encode_archive_scans`), others every bit. Throws Error{kInvalidArgument}
  /// where graph, sessions and CELLs do not belong together, Error{kTooLarge}. Once.
  void finish(const ArchiveContents& contents);

 private:
  void check_next(CellId id, const Cell& cell) const;
  void put_record(CellId id, const Cell& cell, const EncodedCell& raw,
                  std::span<const std::byte> payload);
  void put_directory(ArchiveHead& head);
  void put(std::span<const std::byte> bytes);

  ByteFile& file_;
  LatticeSpec lattice_;
  ArchiveOptions options_;
  std::uint64_t end_ = kArchiveFirstReadBytes;
  std::vector<ArchiveEntry> entries_;
  std::vector<ArchivedCell> cells_;    ///< sessions numbered by first appearance ...
  std::vector<std::string> sessions_;  ///< ... here
};

/// Appends sections, footer and tail at `end` and then says so in the slot that `serial` uses:
/// whatever is cut off in between, the state before stays readable. `footer.sections` name what is
/// there already; `added` are compressed here and named too. Used by the writer and by updates.
ArchiveState append_archive_state(ByteFile& file, std::uint64_t end, std::uint64_t serial,
                                  ArchiveFooter footer,
                                  const std::vector<std::pair<ArchiveSectionKind, Bytes>>& added);

}  // namespace cellmap
