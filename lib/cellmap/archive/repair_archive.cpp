#include "cellmap/archive/repair_archive.hpp"

#include <algorithm>
#include <map>
#include <set>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/archive_writer.hpp"
#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/checksum.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kScannedAtOnce = 1u << 20;

/// Reads forward through a window.
class Scanner {
 public:
  explicit Scanner(ByteSource& source) : source_(source), size_(source.size()) {}

  std::uint64_t size() const { return size_; }

  /// `length` bytes at `offset`, fewer at the end; valid until the next call.
  std::span<const std::byte> at(std::uint64_t offset, std::size_t length) {
    if (offset < begin_ || offset + length > begin_ + window_.size()) {
      begin_ = offset;
      window_ = source_.read(offset, std::max(length, kScannedAtOnce));
    }
    const auto rest = std::span<const std::byte>(window_).subspan(offset - begin_);
    return rest.first(std::min(length, rest.size()));
  }

 private:
  ByteSource& source_;
  std::uint64_t size_, begin_ = 0;
  Bytes window_;
};

/// What is known of a CELL that was found.
struct Found {
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0;
  std::string session;
  Pose T_odom_cell = Pose::Identity();
};

class Repair {
 public:
  Repair(ByteSource& damaged, ByteFile& repaired) : damaged_(damaged), repaired_(repaired) {}

  RepairReport run() {
    read_head();
    read_footer();
    find_records();
    if (found_.empty() && !footer_) {
      throw Error(ErrorCode::kCorruptData,
                  "nothing in '" + damaged_.name() + "' is an intact part of an archive");
    }
    read_sections();
    write();
    report_.cells = found_.size();
    report_.cells_before = std::max<std::uint64_t>(report_.cells, footer_ ? footer_->cells : 0);
    return report_;
  }

 private:
  /// Work on a part that may be damaged: what fails is noted.
  template <typename Work>
  bool attempt(const std::string& part, const Work& work) {
    try {
      work();
      return true;
    } catch (const Error& error) {
      if (is_io(error.code())) throw;
      report_.notes.push_back(part + " is lost: " + error.what());
      return false;
    }
  }

  void read_head() {
    first_ = damaged_.read(0, kArchiveFirstReadBytes);
    attempt("the head", [&] { lattice_ = decode_archive_head(first_).lattice; });
  }

  bool try_state(const ArchiveState& state) {
    try {
      if (state.footer_bytes > kMaxArchiveFooterBytes) return false;
      const Bytes bytes = damaged_.read(state.footer_offset, state.footer_bytes);
      if (bytes.size() != state.footer_bytes || checksum(bytes) != state.footer_checksum) {
        return false;
      }
      footer_ = decode_archive_footer(bytes);
      return true;
    } catch (const Error& error) {
      if (is_io(error.code())) throw;
      return false;
    }
  }

  /// The newest footer that is intact: of the states in the head, or of the tail.
  void read_footer() {
    std::vector<ArchiveState> states;
    const auto keep = [&](const std::optional<ArchiveState>& state) {
      if (state) states.push_back(*state);
    };
    for (const std::uint64_t offset : kArchiveStateOffsets) {
      if (first_.size() > offset) keep(decode_archive_state(std::span(first_).subspan(offset)));
    }
    if (damaged_.size() >= kArchiveTailBytes) {
      keep(decode_archive_tail(
          damaged_.read(damaged_.size() - kArchiveTailBytes, kArchiveTailBytes)));
    }
    std::ranges::stable_sort(states, std::greater<>(), &ArchiveState::serial);
    const bool intact = std::ranges::any_of(states, [&](const auto& s) { return try_state(s); });
    if (!intact)
      report_.notes.push_back(
          "the footer is lost: names, sessions' descriptions and "
          "where poses and scans are");
    if (footer_) lattice_ = footer_->lattice;
  }

  void find_records() {
    Scanner scanner(damaged_);
    const std::uint64_t end = footer_ ? footer_->sections.front().offset : scanner.size();
    for (std::uint64_t at = kArchiveFirstReadBytes; at + kArchiveRecordHeaderBytes <= end;) {
      const auto header = decode_archive_record_header(scanner.at(at, kArchiveRecordHeaderBytes));
      const std::uint64_t bytes =
          header ? kArchiveRecordHeaderBytes + header->payload_bytes : kArchiveAlignment;
      if (header && !take(scanner, at, static_cast<std::uint32_t>(bytes))) {
        report_.notes.push_back("CELL " + std::to_string(header->cell.value) + " is damaged");
      }
      if (!header) report_.bytes_skipped += bytes;
      at += aligned_up(bytes);
    }
  }

  bool take(Scanner& scanner, std::uint64_t offset, std::uint32_t bytes) {
    const auto record = scanner.at(offset, bytes);
    if (record.size() != bytes) return false;
    try {
      const auto spec = lattice_.value_or(lattice_of(record));
      const ArchiveCell cell = decode_archive_record(record, spec);
      if (!encoding_) {
        encoding_ = cell.encoding;
        bound_m_ = cell.bound_m;
      }
      if (cell.encoding != *encoding_) return false;
      bound_m_ = std::max(bound_m_, cell.bound_m);
      lattice_ = spec;
      return found_
          .try_emplace(cell.id, Found{offset, bytes, cell.cell.session, cell.cell.T_odom_cell})
          .second;
    } catch (const Error& error) {
      if (is_io(error.code())) throw;
      return false;
    }
  }

  /// Where head and footer are lost, the first intact CELL says which lattice it is.
  static LatticeSpec lattice_of(std::span<const std::byte> record) {
    const auto header = decode_archive_record_header(record);
    const auto payload = record.subspan(kArchiveRecordHeaderBytes);
    if (header->encoding != ArchiveEncoding::kRaw) return decode_coded_cell(payload).cell.lattice;
    return decode_cell(zstd_decompress(payload, kMaxCellBytes)).lattice;
  }

  Bytes section(ArchiveSectionKind kind) {
    const auto section = std::ranges::find(footer_->sections, kind, &ArchiveSection::kind);
    if (section == footer_->sections.end()) return {};
    const Bytes bytes =
        damaged_.read(section->offset, std::min<std::uint64_t>(section->bytes, damaged_.size()));
    if (checksum(bytes) != section->checksum) {
      throw Error(ErrorCode::kCorruptData, "it fails its checksum");
    }
    return zstd_decompress(bytes, kMaxArchiveSectionBytes);
  }

  void read_sections() {
    contents_.map = "recovered";
    bool has_poses = false;
    if (footer_) {
      contents_.map = footer_->map;
      contents_.created = footer_->created;
      contents_.sessions = footer_->sessions;
      contents_.georeference = footer_->georeference;
      has_poses = attempt("the pose graph", [&] {
        contents_.graph = decode_pose_graph(section(ArchiveSectionKind::kPoseGraph));
      });
      attempt("the last pose update", [&] {
        const Bytes changes = section(ArchiveSectionKind::kChanges);
        if (!has_poses || changes.empty()) return;
        contents_.graph = applied(contents_.graph, decode_changes(changes));
      });
      attempt("the list of scans", [&] {
        contents_.stretches = decode_archive_scans(section(ArchiveSectionKind::kScans));
      });
    }
    for (const auto& [id, cell] : found_) {
      const auto known = std::ranges::find(contents_.sessions, cell.session, &ArchiveSession::name);
      if (known == contents_.sessions.end())
        contents_.sessions.push_back({cell.session, {}, {}, {}, 0});
    }
    if (!has_poses) place_by_odometry();
    drop_lost_cells();
  }

  void place_by_odometry() {
    if (found_.empty()) return;
    report_.notes.push_back(
        "the poses are lost: CELLs are where odometry had them, and nothing "
        "ties sessions together; 'cellmap build' or 'ingest' maps them anew");
    contents_.graph = {};
    contents_.graph.revision = 1;
    const std::string& first = found_.begin()->second.session;
    for (const auto& [id, cell] : found_) {
      contents_.graph.nodes[id] = cell.T_odom_cell;
      if (cell.session != first) contents_.graph.unaligned.insert(id);
    }
  }

  void drop_lost_cells() {
    PoseGraph& graph = contents_.graph;
    for (const auto& [id, cell] : found_) {
      if (graph.nodes.emplace(id, cell.T_odom_cell).second) {
        report_.notes.push_back("CELL " + std::to_string(id.value) + " had no pose");
      }
    }
    const auto lost = [&](CellId id) { return !found_.contains(id); };
    std::erase_if(graph.nodes, [&](const auto& node) { return lost(node.first); });
    std::erase_if(graph.unaligned, lost);
    std::erase_if(graph.constraints,
                  [&](const Constraint& c) { return lost(c.from) || lost(c.to); });
    std::erase_if(contents_.stretches, [&](const auto& stretch) { return lost(stretch.first); });
  }

  void write() {
    ArchiveOptions options;
    options.encoding = encoding_.value_or(footer_ ? footer_->encoding : ArchiveEncoding::kPacked);
    if (options.encoding == ArchiveEncoding::kCompact) {
      options.bound_m = encoding_ ? bound_m_ : footer_->bound_m;
    }
    ArchiveWriter writer(repaired_, *lattice_, options);
    for (const auto& [id, found] : found_) {
      const Bytes record = damaged_.read(found.offset, found.bytes);
      const ArchiveCell cell = decode_archive_record(record, *lattice_);
      writer.add_payload(id, cell.cell, cell.raw_hash,
                         std::span(record).subspan(kArchiveRecordHeaderBytes));
    }
    writer.finish(contents_);
  }

  ByteSource& damaged_;
  ByteFile& repaired_;
  RepairReport report_;
  Bytes first_;
  std::optional<LatticeSpec> lattice_;
  std::optional<ArchiveFooter> footer_;
  std::optional<ArchiveEncoding> encoding_;
  double bound_m_ = 0;
  std::map<CellId, Found> found_;
  ArchiveContents contents_;
};

}  // namespace

RepairReport repair_archive(ByteSource& damaged, ByteFile& repaired) {
  return Repair(damaged, repaired).run();
}

}  // namespace cellmap
