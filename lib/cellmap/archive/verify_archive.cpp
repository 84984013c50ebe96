#include "cellmap/archive/verify_archive.hpp"

#include <algorithm>

#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/checksum.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// One look at one file; each step adds to the report what it finds.
class Verification {
 public:
  Verification(ByteSource& source, const std::function<void(const ArchiveCell&)>& on_cell)
      : source_(source), on_cell_(on_cell) {}

  ArchiveReport run() {
    report_.bytes = source_.size();
    first_ = source_.read(0, kArchiveFirstReadBytes);
    check_states();
    std::optional<ArchiveReader> reader;
    const bool opened = attempt([&] { reader.emplace(borrowed(source_)); });
    if (!opened) return report_;
    check_padding_of_head(reader->head());
    check_end(reader->state());
    attempt([&] { footer_ = reader->footer(); });
    attempt([&] { listed_ = reader->cells(); });
    attempt([&] { reader->pose_graph(); });
    attempt([&] { reader->scans(); });
    check_sections(*reader);
    attempt([&] { check_records(*reader); });
    check_counts();
    return report_;
  }

 private:
  /// Work whose errors are findings. What the source itself throws is none.
  template <typename Work>
  bool attempt(const Work& work) {
    try {
      work();
      return true;
    } catch (const Error& error) {
      const bool is_finding = error.code() == ErrorCode::kCorruptData ||
                              error.code() == ErrorCode::kUnsupported ||
                              error.code() == ErrorCode::kTooLarge;
      if (!is_finding) throw;
      add(error.what());
      return false;
    }
  }

  void add(const std::string& finding) {
    if (std::ranges::find(report_.damage, finding) == report_.damage.end()) {
      report_.damage.push_back(finding);
    }
  }

  static bool is_zero(std::span<const std::byte> bytes) {
    return std::ranges::all_of(bytes, [](std::byte b) { return b == std::byte{0}; });
  }

  void check_zero(std::uint64_t begin, std::uint64_t end, const char* where) {
    if (begin >= end) return;
    if (!is_zero(source_.read(begin, end - begin))) {
      add(std::string("bytes that are always zero are not, ") + where + ", between " +
          std::to_string(begin) + " and " + std::to_string(end));
    }
  }

  void check_states() {
    int valid = 0, empty = 0;
    for (const std::uint64_t offset : kArchiveStateOffsets) {
      if (first_.size() < offset + kArchiveStateBytes) return;
      const auto bytes = std::span(first_).subspan(offset, kArchiveStateBytes);
      valid += decode_archive_state(bytes).has_value();
      empty += is_zero(bytes);
    }
    const auto newest = newest_archive_state(first_);
    const bool second_expected = newest && newest->serial > 1;
    if (valid + empty != 2 || (second_expected && valid != 2)) {
      add("one of the two states is damaged: the pointer to the footer has no spare");
    }
    if (!newest) return;
    const auto other = decode_archive_state(
        std::span(first_).subspan(kArchiveStateOffsets[(newest->serial + 1) % 2]));
    if (other && other->serial + 1 != newest->serial) add("the states do not follow one another");
  }

  void check_padding_of_head(const ArchiveHead& head) {
    const auto& slots = kArchiveStateOffsets;
    check_zero(kArchiveHeadBytes, slots[0], "behind the head");
    check_zero(slots[0] + kArchiveStateBytes, slots[1], "behind the first state");
    check_zero(slots[1] + kArchiveStateBytes, kArchiveRootOffset, "behind the second state");
    check_zero(kArchiveRootOffset + head.root_bytes, kArchiveFirstReadBytes, "behind the root");
  }

  void check_end(const ArchiveState& state) {
    const auto tail =
        decode_archive_tail(source_.read(state.end - kArchiveTailBytes, kArchiveTailBytes));
    if (tail != state) add("the last bytes are not those of an archive that ends here");
    check_zero(state.footer_offset + state.footer_bytes, state.end - kArchiveTailBytes,
               "behind the footer");
    if (report_.bytes > state.end) {
      add(std::to_string(report_.bytes - state.end) +
          " bytes behind the end belong to an update that was not finished; the state before it is "
          "intact, and the next update removes them");
    }
  }

  void check_sections(ArchiveReader& reader) {
    if (!footer_) return;
    for (const ArchiveSection& section : footer_->sections) {
      check_zero(section.offset + section.bytes, section.end(), "behind a section");
      if (section.kind != ArchiveSectionKind::kSuperseded) continue;  // the others were read
      const Bytes bytes = source_.read(section.offset, section.bytes);
      if (checksum(bytes) != section.checksum) add("bytes that an update left behind are damaged");
    }
    if (reader.state().block_offset != footer_->sections.front().offset &&
        reader.state().serial == 1) {
      add("the first state does not begin where the CELLs end");
    }
  }

  void check_records(ArchiveReader& reader) {
    std::uint64_t at = kArchiveFirstReadBytes;
    std::size_t row = 0;
    for (const ArchiveEntry& entry : reader.entries()) {
      if (entry.offset != at) add("there is a gap before CELL " + std::to_string(entry.cell.value));
      at = entry.end();
      check_zero(entry.offset + entry.bytes, entry.end(), "behind a record");
      const ArchivedCell* listed = row < listed_.size() ? &listed_[row] : nullptr;
      ++row;
      const bool good = attempt([&] { check_record(reader, entry, listed); });
      if (!good) report_.lost.push_back(entry.cell);
    }
    if (at != reader.head().records_end || row != reader.head().cells) {
      add("the directory does not name all records");
    }
    if (reader.head().has_leaves) return;  // whose checksums the root has
    if (reader.head().data_end != at) add("there is a gap behind the records");
  }

  void check_record(ArchiveReader& reader, const ArchiveEntry& entry, const ArchivedCell* listed) {
    const Bytes record = source_.read(entry.offset, entry.bytes);
    const ArchiveCell cell = decode_archive_record(record, reader.head().lattice);
    const auto mismatch = [&](const char* what) {
      return Error(ErrorCode::kCorruptData,
                   "CELL " + std::to_string(entry.cell.value) + " " + what);
    };
    if (cell.id != entry.cell) throw mismatch("is not where the directory says");
    if (footer_ && (cell.encoding != footer_->encoding || cell.bound_m > footer_->bound_m)) {
      throw mismatch("has another encoding or a wider bound than the footer says");
    }
    if (listed && footer_) {
      const bool same = listed->id == cell.id && listed->hash == cell.raw_hash &&
                        footer_->sessions[listed->session].name == cell.cell.session &&
                        listed->sequence == cell.cell.sequence &&
                        listed->planes == cell.cell.planes.size();
      if (!same) throw mismatch("is not the one of the list");
    }
    ++report_.cells;
    report_.planes += cell.cell.planes.size();
    if (on_cell_) on_cell_(cell);
  }

  void check_counts() {
    if (!footer_ || !report_.damage.empty()) return;
    if (footer_->planes != report_.planes) add("the footer's number of planes is wrong");
    std::uint64_t bytes = 0;
    for (const ArchivedCell& cell : listed_) bytes += cell.bytes;
    if (bytes != footer_->cell_bytes) add("the footer's number of bytes is wrong");
  }

  ByteSource& source_;
  const std::function<void(const ArchiveCell&)>& on_cell_;
  ArchiveReport report_;
  Bytes first_;
  std::optional<ArchiveFooter> footer_;
  std::vector<ArchivedCell> listed_;
};

}  // namespace

ArchiveReport verify_archive(ByteSource& source,
                             const std::function<void(const ArchiveCell&)>& on_cell) {
  return Verification(source, on_cell).run();
}

}  // namespace cellmap
