#include "cellmap/archive/archive_writer.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include "cellmap/archive/archive_precision.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/checksum.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kCellsPerLeaf = 4096;
constexpr double kHalfMicro = 5e-7;  // of a metre: bounds are whole micrometres
constexpr int kLevel = 19;           // an archive is written once

[[noreturn]] void invalid(const std::string& what) {
  throw Error(ErrorCode::kInvalidArgument, "this cannot be archived: " + what);
}

/// The CELL as its record keeps it.
Bytes payload_of(const Cell& cell, const EncodedCell& raw, const ArchiveOptions& options) {
  switch (options.encoding) {
    case ArchiveEncoding::kRaw:
      return zstd_compress(raw.bytes, kLevel);
    case ArchiveEncoding::kPacked:
      return encode_packed_cell(cell).bytes;
    case ArchiveEncoding::kCompact:
      return encode_compact_cell(cell, options.bound_m).bytes;
  }
  throw Error(ErrorCode::kInternal, "an archive's encoding is none");
}

/// Bytes at the end of a file; zeros fill up to the alignment.
void append(ByteFile& file, std::uint64_t& end, std::span<const std::byte> bytes) {
  Bytes padded(bytes.begin(), bytes.end());
  padded.resize(aligned_up(bytes.size()));
  file.write(end, padded);
  end += padded.size();
}

}  // namespace

void ArchiveOptions::validate() const {
  if (encoding != ArchiveEncoding::kCompact) return;
  if (!(bound_m >= kMinCompactBoundM && bound_m <= kMaxCompactBoundM)) {
    throw Error(
        ErrorCode::kInvalidArgument,
        "the bound of compact CELLs lies between 0.001 and 1 m, found " + std::to_string(bound_m));
  }
}

ArchiveWriter::ArchiveWriter(ByteFile& file, const LatticeSpec& lattice,
                             const ArchiveOptions& options)
    : file_(file), lattice_(lattice), options_(options) {
  options_.validate();
  // In whole micrometres, as the CELLs keep it.
  options_.bound_m = options_.encoding == ArchiveEncoding::kCompact
                         ? std::floor(options_.bound_m * 1e6 + 1e-3) * 1e-6
                         : 0;
  Bytes first(kArchiveFirstReadBytes);
  const Bytes head = encode_archive_head({.lattice = lattice_});
  std::copy(head.begin(), head.end(), first.begin());
  file_.write(0, first);
}

void ArchiveWriter::put(std::span<const std::byte> bytes) { append(file_, end_, bytes); }

void ArchiveWriter::add(CellId id, const Cell& cell) {
  check_next(id, cell);
  const EncodedCell raw = encode_cell(cell);
  put_record(id, cell, raw, payload_of(cell, raw, options_));
}

void ArchiveWriter::add(CellId id, const KeptCell& cell) {
  const std::optional<CodedCopy>& coded = cell.coded;
  if (!coded || (coded->form.is_exact() && options_.encoding != ArchiveEncoding::kPacked)) {
    return add(id, *cell.cell);
  }
  const double bound_m = coded->form.bound_m();
  if (!coded->form.is_exact() &&
      (options_.encoding != ArchiveEncoding::kCompact || bound_m > options_.bound_m + kHalfMicro)) {
    throw Error(ErrorCode::kConflict,
                "CELL " + std::to_string(id.value) + " is kept as '" + to_string(coded->form) +
                    "' and its source is gone: an archive of it has the encoding compact, with at "
                    "least that bound");
  }
  check_next(id, *cell.cell);
  put_record(id, *cell.cell, {coded->source, cell.encoded.bytes}, coded->content.bytes);
}

void ArchiveWriter::add_payload(CellId id, const Cell& cell, const ContentHash& raw_hash,
                                std::span<const std::byte> payload) {
  check_next(id, cell);
  put_record(id, cell, {raw_hash, encode_cell(cell).bytes}, payload);
}

void ArchiveWriter::check_next(CellId id, const Cell& cell) const {
  if (!entries_.empty() && id <= entries_.back().cell) invalid("its CELLs' ids do not increase");
  if (cell.lattice != lattice_) invalid("a CELL has another lattice than the others");
  if (entries_.size() >= kMaxArchiveCells) {
    throw Error(ErrorCode::kTooLarge, "an archive has at most " + std::to_string(kMaxArchiveCells) +
                                          " CELLs; split the map");
  }
}

void ArchiveWriter::put_record(CellId id, const Cell& cell, const EncodedCell& raw,
                               std::span<const std::byte> payload) {
  const ArchiveRecordHeader header{.cell = id,
                                   .payload_bytes = static_cast<std::uint32_t>(payload.size()),
                                   .payload_checksum = checksum(payload),
                                   .encoding = options_.encoding};
  Bytes record = encode_archive_record_header(header);
  record.insert(record.end(), payload.begin(), payload.end());
  auto session = std::ranges::find(sessions_, cell.session);
  if (session == sessions_.end()) session = sessions_.insert(session, cell.session);
  cells_.push_back({id, raw.hash, static_cast<std::uint32_t>(session - sessions_.begin()),
                    cell.sequence, static_cast<std::uint32_t>(cell.planes.size()),
                    raw.bytes.size()});
  entries_.push_back({id, end_, static_cast<std::uint32_t>(record.size()), 0});
  put(record);
}

void ArchiveWriter::put_directory(ArchiveHead& head) {
  head.records_end = end_;
  Bytes root = encode_archive_directory(entries_, kArchiveFirstReadBytes, false);
  if (root.size() > kMaxArchiveRootBytes) {
    head.has_leaves = true;
    std::vector<ArchiveEntry> leaves;
    for (std::size_t i = 0; i < entries_.size(); i += kCellsPerLeaf) {
      const auto part =
          std::span(entries_).subspan(i, std::min(kCellsPerLeaf, entries_.size() - i));
      const Bytes leaf = encode_archive_directory(part, kArchiveFirstReadBytes, false);
      leaves.push_back(
          {part.front().cell, end_, static_cast<std::uint32_t>(leaf.size()), checksum(leaf)});
      put(leaf);
    }
    root = encode_archive_directory(leaves, head.records_end, true);
  }
  head.cells = entries_.size();
  head.data_end = end_;
  head.root_bytes = static_cast<std::uint32_t>(root.size());
  head.root_checksum = checksum(root);
  file_.write(kArchiveRootOffset, root);
}

void ArchiveWriter::finish(const ArchiveContents& contents) {
  ArchiveFooter footer;
  footer.map = contents.map;
  footer.created = contents.created;
  footer.lattice = lattice_;
  footer.encoding = options_.encoding;
  footer.bound_m = options_.bound_m;
  footer.revision = contents.graph.revision;
  footer.cells = cells_.size();
  footer.sessions = contents.sessions;
  footer.georeference = contents.georeference;
  for (ArchivedCell& cell : cells_) {
    const std::string& name = sessions_[cell.session];
    const auto session = std::ranges::find(footer.sessions, name, &ArchiveSession::name);
    if (session == footer.sessions.end()) invalid("session '" + name + "' is not described");
    cell.session = static_cast<std::uint32_t>(session - footer.sessions.begin());
    footer.planes += cell.planes;
    footer.cell_bytes += cell.bytes;
    if (!contents.graph.nodes.contains(cell.id)) {
      invalid("CELL " + std::to_string(cell.id.value) + " has no pose");
    }
  }
  if (contents.graph.nodes.size() != cells_.size()) invalid("a pose belongs to no CELL");
  for (const auto& [id, stretch] : contents.stretches) {
    if (!contents.graph.nodes.contains(id)) invalid("scans belong to no CELL");
    footer.scans += stretch.scans.size();
  }
  ArchiveHead head{.lattice = lattice_};
  put_directory(head);
  const bool is_exact = options_.encoding != ArchiveEncoding::kCompact;
  append_archive_state(
      file_, end_, 1, footer,
      {{ArchiveSectionKind::kScans, encode_archive_scans(contents.stretches, is_exact)},
       {ArchiveSectionKind::kCells, encode_archive_cells(cells_)},
       {ArchiveSectionKind::kPoseGraph,
        encode_pose_graph(is_exact ? contents.graph : to_archive_precision(contents.graph))}});
  file_.write(0, encode_archive_head(head));
  file_.sync();
}

ArchiveState append_archive_state(ByteFile& file, std::uint64_t end, std::uint64_t serial,
                                  ArchiveFooter footer,
                                  const std::vector<std::pair<ArchiveSectionKind, Bytes>>& added) {
  ArchiveState state;
  state.serial = serial;
  state.block_offset = end;
  if (file.size() > end) file.resize(end);  // what an update that was broken off left
  for (const auto& [kind, bytes] : added) {
    const Bytes frame = zstd_compress(bytes, kLevel);
    footer.sections.push_back({kind, end, frame.size(), checksum(frame)});
    append(file, end, frame);
  }
  const Bytes bytes = encode_archive_footer(footer);
  state.footer_offset = end;
  state.footer_bytes = bytes.size();
  state.footer_checksum = checksum(bytes);
  append(file, end, bytes);
  state.end = end + kArchiveTailBytes;
  file.write(end, encode_archive_tail(state));
  file.sync();  // before anything points there
  file.write(kArchiveStateOffsets[serial % 2], encode_archive_state(state));
  file.sync();
  return state;
}

}  // namespace cellmap
