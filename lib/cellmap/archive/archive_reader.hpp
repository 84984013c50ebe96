#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "cellmap/archive/byte_source.hpp"
#include "cellmap/codec/archive_cells.hpp"
#include "cellmap/codec/archive_directory.hpp"
#include "cellmap/codec/archive_footer.hpp"
#include "cellmap/pose_graph/map_changes.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"

namespace cellmap {

/// A CELL out of an archive.
struct ArchiveCell {
  CellId id;
  ArchiveEncoding encoding = ArchiveEncoding::kRaw;
  ContentHash raw_hash{};  ///< of the CELL that was archived, as `encode_cell` has it
  double bound_m = 0;  ///< how far planes may be from those of that CELL; 0: every bit is theirs
  Cell cell{};
  Bytes coded{};  ///< the coded CELL as it lies in the archive; empty where it is raw
};

/// Reads an archive with few and small reads, as befits one behind HTTP: the first tells where
/// everything is, the second has footer, poses and list of CELLs unless they are large, and then
/// any CELL is one read (two where the archive has more CELLs than fit in its root directory and
/// the leaf is not the last one used).
///
/// Trusts no byte: what is handed out has passed its checksum, its format and its limits. Throws
/// Error{kCorruptData} saying what is damaged, {kUnsupported}, and what the source throws. Where
/// the file was replaced between two reads (Error{kPreconditionFailed} from the source), it is
/// opened anew, once a call: what was handed out before may belong to the old one. Not thread safe.
class ArchiveReader {
 public:
  explicit ArchiveReader(std::unique_ptr<ByteSource> source);

  const ArchiveHead& head() const { return head_; }
  const ArchiveState& state() const { return state_; }
  ByteSource& source() { return *source_; }

  const ArchiveFooter& footer();
  const std::vector<ArchivedCell>& cells();  ///< by id
  const PoseGraph& pose_graph();
  const std::map<CellId, CellScans>& scans();

  /// Throws Error{kNotFound} for a CELL that the archive does not have.
  ArchiveCell cell(CellId id);
  /// The record of a CELL as it lies in the file; for `decode_archive_record`.
  Bytes record(CellId id);
  /// CELLs by increasing id, neighbours in the file with one read of a few MB.
  void for_each_cell(std::span<const CellId> ids,
                     const std::function<void(const ArchiveCell&)>& on_cell);

  /// Where the record of a CELL is; nullopt: it has none.
  std::optional<ArchiveEntry> find(CellId id);
  /// Of all CELLs.
  std::vector<ArchiveEntry> entries();

 private:
  void open();
  Bytes read_exactly(std::uint64_t offset, std::uint64_t length);
  Bytes section(ArchiveSectionKind kind);
  const std::vector<ArchiveEntry>& leaf(const ArchiveEntry& entry);
  template <typename Work>
  auto on_one_file(const Work& work);

  const ArchiveFooter& load_footer();
  const std::vector<ArchivedCell>& load_cells();
  const PoseGraph& load_graph();

  std::unique_ptr<ByteSource> source_;
  ArchiveHead head_;
  ArchiveState state_;
  std::vector<ArchiveEntry> root_;
  CellId leaf_of_;  ///< first CELL of `leaf_`
  std::vector<ArchiveEntry> leaf_;
  std::uint64_t window_offset_ = 0;  ///< the last bytes before the tail, as far as they were read
  Bytes window_;
  std::optional<ArchiveFooter> footer_;
  std::optional<std::vector<ArchivedCell>> cells_;
  std::optional<PoseGraph> graph_;
  std::optional<std::map<CellId, CellScans>> scans_;
};

/// The CELL of a record: header and payload. Throws Error{kCorruptData}.
ArchiveCell decode_archive_record(std::span<const std::byte> record, const LatticeSpec& lattice);

/// The newest of the states that the first read of an archive holds; nullopt: neither is valid.
std::optional<ArchiveState> newest_archive_state(std::span<const std::byte> first_read);

/// The pose graph of an archive whose changes lead from its first one to its newest. Throws
/// Error{kCorruptData} where they do not fit.
PoseGraph applied(PoseGraph graph, const MapChanges& changes);

}  // namespace cellmap
