#include "cellmap/archive/archive_reader.hpp"

#include <algorithm>
#include <array>

#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/checksum.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::uint64_t kWindowBytes = 1u << 20;
constexpr std::uint64_t kReadBytes = 4u << 20;
/// Sections are zstd frames of at most this; what is stored is no larger by much.
constexpr std::uint64_t kMaxFrameBytes = kMaxArchiveSectionBytes + (8u << 20);

Error corrupt(const std::string& what) {
  return Error(ErrorCode::kCorruptData,
               "the archive is damaged: " + what + "; 'cellmap repair' recovers what is intact");
}

void check_sum(std::span<const std::byte> bytes, std::uint64_t expected, const std::string& what) {
  if (checksum(bytes) != expected) throw corrupt(what + " fails its checksum");
}

std::string name_of(CellId id) { return "CELL " + std::to_string(id.value); }

/// The last entry whose first CELL is not behind `id`.
const ArchiveEntry* entry_before(const std::vector<ArchiveEntry>& entries, CellId id) {
  const auto after = std::ranges::upper_bound(entries, id, {}, &ArchiveEntry::cell);
  return after == entries.begin() ? nullptr : &*std::prev(after);
}

}  // namespace

std::optional<ArchiveState> newest_archive_state(std::span<const std::byte> first_read) {
  std::optional<ArchiveState> newest;
  for (const std::uint64_t offset : kArchiveStateOffsets) {
    if (first_read.size() < offset + kArchiveStateBytes) continue;
    const auto state = decode_archive_state(first_read.subspan(offset));
    if (state && (!newest || state->serial > newest->serial)) newest = state;
  }
  return newest;
}

ArchiveCell decode_archive_record(std::span<const std::byte> record, const LatticeSpec& lattice) {
  const auto header = decode_archive_record_header(record);
  if (!header || record.size() != kArchiveRecordHeaderBytes + header->payload_bytes) {
    throw corrupt("a record has no valid header");
  }
  const auto payload = record.subspan(kArchiveRecordHeaderBytes);
  check_sum(payload, header->payload_checksum, name_of(header->cell));
  ArchiveCell cell{.id = header->cell, .encoding = header->encoding};
  if (header->encoding == ArchiveEncoding::kRaw) {
    const Bytes bytes = zstd_decompress(payload, kMaxCellBytes);
    cell.cell = decode_cell(bytes);
    cell.raw_hash = verified_hash(bytes);
  } else {
    DecodedCell decoded = decode_coded_cell(payload);
    const auto expected = header->encoding == ArchiveEncoding::kPacked ? CellEncoding::kPacked
                                                                       : CellEncoding::kCompact;
    if (decoded.encoding != expected) throw corrupt(name_of(header->cell) + " is coded otherwise");
    cell.raw_hash = decoded.raw_hash;
    cell.bound_m = decoded.bound_m;
    cell.cell = std::move(decoded.cell);
    cell.coded.assign(payload.begin(), payload.end());
  }
  if (cell.cell.lattice != lattice) throw corrupt(name_of(cell.id) + " has another lattice");
  return cell;
}

PoseGraph applied(PoseGraph graph, const MapChanges& changes) {
  const auto misfit = [] { return corrupt("its changes do not fit its pose graph"); };
  if (changes.since != graph.revision || !changes.added.empty() || !changes.removed.empty()) {
    throw misfit();
  }
  for (const auto& [id, pose] : changes.moved) {
    const auto node = graph.nodes.find(id);
    if (node == graph.nodes.end()) throw misfit();
    node->second = pose;
  }
  std::erase_if(graph.constraints, [&](const Constraint& constraint) {
    return std::ranges::binary_search(changes.removed_constraints, constraint.id);
  });
  for (Constraint& constraint : graph.constraints) {
    const auto judged = changes.judged.find(constraint.id);
    if (judged == changes.judged.end()) continue;
    constraint.weight = judged->second.weight;
    constraint.pinned = judged->second.pinned;
  }
  for (const Constraint& constraint : changes.added_constraints) {
    if (!graph.nodes.contains(constraint.from) || !graph.nodes.contains(constraint.to)) {
      throw misfit();
    }
    graph.constraints.push_back(constraint);
  }
  std::ranges::stable_sort(graph.constraints, {}, &Constraint::id);
  for (const CellId id : changes.unaligned) {
    if (!graph.nodes.contains(id)) throw misfit();
  }
  graph.unaligned = changes.unaligned;
  graph.revision = changes.revision;
  return graph;
}

ArchiveReader::ArchiveReader(std::unique_ptr<ByteSource> source) : source_(std::move(source)) {
  try {
    open();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kPreconditionFailed) throw;
    open();
  }
}

void ArchiveReader::open() {
  source_->restart();
  footer_.reset();
  cells_.reset();
  graph_.reset();
  scans_.reset();
  leaf_.clear();
  window_.clear();
  const Bytes first = source_->read(0, kArchiveFirstReadBytes);
  head_ = decode_archive_head(first);
  if (head_.records_end == 0) {
    throw corrupt("'" + source_->name() + "' was never finished");
  }
  if (first.size() < kArchiveFirstReadBytes) throw corrupt("it ends within its root directory");
  const auto state = newest_archive_state(first);
  if (!state) throw corrupt("both of its states fail their checksums");
  state_ = *state;
  if (state_.end > source_->size()) {
    throw corrupt("it was cut off: expected " + std::to_string(state_.end) + " bytes, found " +
                  std::to_string(source_->size()));
  }
  if (state_.block_offset < head_.data_end) throw corrupt("its footer lies among its CELLs");
  const auto root = std::span(first).subspan(kArchiveRootOffset, head_.root_bytes);
  check_sum(root, head_.root_checksum, "the root directory");
  root_ = head_.has_leaves
              ? decode_archive_directory(root, head_.records_end, head_.data_end, true)
              : decode_archive_directory(root, kArchiveFirstReadBytes, head_.records_end, false);
}

/// Runs work that reads, and runs it once more on the new file where it was replaced meanwhile.
template <typename Work>
auto ArchiveReader::on_one_file(const Work& work) {
  try {
    return work();
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kPreconditionFailed) throw;
  }
  open();
  return work();
}

Bytes ArchiveReader::read_exactly(std::uint64_t offset, std::uint64_t length) {
  Bytes bytes = source_->read(offset, length);
  if (bytes.size() != length) throw corrupt("it ends early");
  return bytes;
}

const ArchiveFooter& ArchiveReader::load_footer() {
  if (footer_) return *footer_;
  if (state_.footer_bytes > kMaxArchiveFooterBytes) throw corrupt("its footer is too large");
  const std::uint64_t end = state_.end - kArchiveTailBytes;
  const std::uint64_t wanted = std::max(kWindowBytes, aligned_up(state_.footer_bytes));
  window_offset_ = std::max(state_.block_offset, end - std::min(end, wanted));
  window_ = read_exactly(window_offset_, end - window_offset_);
  const auto bytes =
      std::span(window_).subspan(state_.footer_offset - window_offset_, state_.footer_bytes);
  check_sum(bytes, state_.footer_checksum, "the footer");
  ArchiveFooter footer = decode_archive_footer(bytes);
  if (footer.lattice != head_.lattice || footer.cells != head_.cells ||
      footer.sections.front().offset != head_.data_end ||
      footer.sections.back().end() != state_.footer_offset) {
    throw corrupt("its footer belongs to another head");
  }
  return footer_.emplace(std::move(footer));
}

Bytes ArchiveReader::section(ArchiveSectionKind kind) {
  const ArchiveFooter& footer = load_footer();
  const auto found = std::ranges::find(footer.sections, kind, &ArchiveSection::kind);
  if (found == footer.sections.end()) return {};
  if (found->bytes > kMaxFrameBytes) throw corrupt("a section is too large");
  const std::string name = "the section '" + std::string(to_string(kind)) + "'";
  if (found->offset >= window_offset_) {
    const auto bytes = std::span(window_).subspan(found->offset - window_offset_, found->bytes);
    check_sum(bytes, found->checksum, name);
    return zstd_decompress(bytes, kMaxArchiveSectionBytes);
  }
  const Bytes bytes = read_exactly(found->offset, found->bytes);
  check_sum(bytes, found->checksum, name);
  return zstd_decompress(bytes, kMaxArchiveSectionBytes);
}

const std::vector<ArchivedCell>& ArchiveReader::load_cells() {
  if (cells_) return *cells_;
  auto cells =
      decode_archive_cells(section(ArchiveSectionKind::kCells), load_footer().sessions.size());
  if (cells.size() != head_.cells) throw corrupt("its list of CELLs is not as long as it says");
  return cells_.emplace(std::move(cells));
}

const PoseGraph& ArchiveReader::load_graph() {
  if (graph_) return *graph_;
  PoseGraph graph = decode_pose_graph(section(ArchiveSectionKind::kPoseGraph));
  const Bytes changes = section(ArchiveSectionKind::kChanges);
  if (!changes.empty()) graph = applied(std::move(graph), decode_changes(changes));
  const auto& cells = load_cells();
  const bool fits = std::ranges::equal(
      cells, graph.nodes, [](const auto& cell, const auto& node) { return cell.id == node.first; });
  if (!fits) throw corrupt("its poses are not those of its CELLs");
  if (!cells.empty()) graph.next_cell = CellId{cells.back().id.value + 1};
  return graph_.emplace(std::move(graph));
}

const ArchiveFooter& ArchiveReader::footer() {
  on_one_file([&] { load_footer(); });
  return *footer_;
}

const std::vector<ArchivedCell>& ArchiveReader::cells() {
  on_one_file([&] { load_cells(); });
  return *cells_;
}

const PoseGraph& ArchiveReader::pose_graph() {
  on_one_file([&] { load_graph(); });
  return *graph_;
}

const std::map<CellId, CellScans>& ArchiveReader::scans() {
  on_one_file([&] {
    if (!scans_) scans_ = decode_archive_scans(section(ArchiveSectionKind::kScans));
  });
  return *scans_;
}

const std::vector<ArchiveEntry>& ArchiveReader::leaf(const ArchiveEntry& entry) {
  if (!leaf_.empty() && leaf_of_ == entry.cell) return leaf_;
  const Bytes bytes = read_exactly(entry.offset, entry.bytes);
  check_sum(bytes, entry.checksum, "a leaf directory");
  auto entries = decode_archive_directory(bytes, kArchiveFirstReadBytes, head_.records_end, false);
  if (entries.empty() || entries.front().cell != entry.cell) {
    throw corrupt("a leaf directory begins with another CELL");
  }
  leaf_ = std::move(entries);
  leaf_of_ = entry.cell;
  return leaf_;
}

std::optional<ArchiveEntry> ArchiveReader::find(CellId id) {
  return on_one_file([&]() -> std::optional<ArchiveEntry> {
    const ArchiveEntry* entry = entry_before(root_, id);
    if (entry && head_.has_leaves) entry = entry_before(leaf(*entry), id);
    return entry && entry->cell == id ? std::optional(*entry) : std::nullopt;
  });
}

std::vector<ArchiveEntry> ArchiveReader::entries() {
  return on_one_file([&] {
    if (!head_.has_leaves) return root_;
    std::vector<ArchiveEntry> all;
    for (const ArchiveEntry& entry : root_) {
      const auto& part = leaf(entry);
      all.insert(all.end(), part.begin(), part.end());
    }
    return all;
  });
}

Bytes ArchiveReader::record(CellId id) {
  return on_one_file([&] {
    const auto entry = find(id);
    if (!entry) throw Error(ErrorCode::kNotFound, "the archive has no " + name_of(id));
    return read_exactly(entry->offset, entry->bytes);
  });
}

ArchiveCell ArchiveReader::cell(CellId id) {
  ArchiveCell cell = decode_archive_record(record(id), head_.lattice);
  if (cell.id != id) throw corrupt(name_of(id) + " is not where the directory says");
  return cell;
}

void ArchiveReader::for_each_cell(std::span<const CellId> ids,
                                  const std::function<void(const ArchiveCell&)>& on_cell) {
  for (std::size_t i = 0; i < ids.size();) {
    std::vector<ArchiveEntry> run;
    Bytes bytes;
    on_one_file([&] {
      run.clear();
      for (std::size_t k = i; k < ids.size(); ++k) {
        const auto entry = find(ids[k]);
        if (!entry) throw Error(ErrorCode::kNotFound, "the archive has no " + name_of(ids[k]));
        if (!run.empty() &&
            (entry->offset != run.back().end() || entry->end() - run.front().offset > kReadBytes)) {
          break;
        }
        run.push_back(*entry);
      }
      const std::uint64_t begin = run.front().offset;
      bytes = read_exactly(begin, run.back().offset + run.back().bytes - begin);
    });
    for (const ArchiveEntry& entry : run) {
      const auto record = std::span(bytes).subspan(entry.offset - run.front().offset, entry.bytes);
      const ArchiveCell cell = decode_archive_record(record, head_.lattice);
      if (cell.id != entry.cell) throw corrupt(name_of(entry.cell) + " is not in its place");
      on_cell(cell);
    }
    i += run.size();
  }
}

}  // namespace cellmap
