#include "cellmap/codec/archive_layout.hpp"

#include <bit>
#include <cstring>
#include <string>

#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/core/checksum.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

static_assert(std::endian::native == std::endian::little, "numbers are copied as they lie");

// 0x89 is in no text; a carriage return, line feed and end of file show what a transfer as text
// does to a file (as PNG has it).
constexpr std::array<char, 8> kHeadMagic = {'\x89', 'C', 'E', 'L', 'L', 'M', 'A', 'P'};
constexpr std::array<char, 8> kRecordMagic = {'\x89', 'C', 'E', 'L', 'L', '\r', '\n', '\x1a'};
constexpr std::array<char, 8> kTailMagic = {'P', 'A', 'M', 'L', 'L', 'E', 'C', '\x89'};
constexpr std::uint8_t kArchivedLatticeVersion = 1;
constexpr std::uint32_t kHasLeaves = 1;

template <typename T>
void put(Bytes& bytes, const T& value) {
  const std::size_t end = bytes.size();
  bytes.resize(end + sizeof(T));
  std::memcpy(bytes.data() + end, &value, sizeof(T));
}

/// Reads numbers one after another; the caller has checked the length.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : rest_(bytes) {}

  template <typename T>
  T get() {
    T value;
    std::memcpy(&value, rest_.data(), sizeof(T));
    rest_ = rest_.subspan(sizeof(T));
    return value;
  }

 private:
  std::span<const std::byte> rest_;
};

bool begins_with(std::span<const std::byte> bytes, const std::array<char, 8>& magic) {
  return bytes.size() >= magic.size() && std::memcmp(bytes.data(), magic.data(), magic.size()) == 0;
}

/// The last 8 of `size` bytes are the checksum of those before.
bool is_sealed(std::span<const std::byte> bytes, std::size_t size) {
  if (bytes.size() < size) return false;
  return Reader(bytes.subspan(size - 8)).get<std::uint64_t>() == checksum(bytes.first(size - 8));
}

Error corrupt_layout(const std::string& what) {
  return Error(ErrorCode::kCorruptData, "this is no archive that can be read: " + what);
}

bool is_plausible(const ArchiveState& state) {
  return state.serial > 0 && state.block_offset >= kArchiveFirstReadBytes &&
         state.footer_offset >= state.block_offset && state.footer_bytes <= kMaxArchiveBytes &&
         state.footer_offset <= kMaxArchiveBytes && state.end <= kMaxArchiveBytes &&
         aligned_up(state.footer_offset + state.footer_bytes) + kArchiveTailBytes == state.end;
}

}  // namespace

ArchiveEncoding archive_encoding_from_string(std::string_view name) {
  for (const auto encoding :
       {ArchiveEncoding::kRaw, ArchiveEncoding::kPacked, ArchiveEncoding::kCompact}) {
    if (to_string(encoding) == name) return encoding;
  }
  throw Error(ErrorCode::kInvalidArgument,
              "an archive's encoding is raw, packed or compact, not '" + std::string(name) + "'");
}

Bytes encode_archive_head(const ArchiveHead& head) {
  Bytes bytes;
  put(bytes, kHeadMagic);
  put(bytes, kFormatVersion);
  put(bytes, static_cast<std::uint8_t>(head.lattice.kind));
  put(bytes, kArchivedLatticeVersion);
  put(bytes, head.lattice.size);
  put(bytes, head.cells);
  put(bytes, head.records_end);
  put(bytes, head.data_end);
  put(bytes, head.root_bytes);
  put(bytes, head.has_leaves ? kHasLeaves : 0u);
  put(bytes, head.root_checksum);
  put(bytes, checksum(bytes));
  return bytes;
}

ArchiveHead decode_archive_head(std::span<const std::byte> bytes) {
  if (!begins_with(bytes, kHeadMagic)) throw corrupt_layout("its first bytes are not those of one");
  if (bytes.size() < kArchiveHeadBytes) throw corrupt_layout("it ends within its head");
  Reader reader(bytes.subspan(kHeadMagic.size()));
  const auto version = reader.get<std::uint16_t>();
  if (version != kFormatVersion) {
    throw Error(ErrorCode::kUnsupported, "the archive has the format version " +
                                             std::to_string(version) +
                                             ", but this build reads version " +
                                             std::to_string(kFormatVersion) + "; update CELLmap");
  }
  if (!is_sealed(bytes, kArchiveHeadBytes)) {
    throw corrupt_layout("its head is damaged; 'cellmap repair' recovers what is intact");
  }
  ArchiveHead head;
  head.lattice.kind = static_cast<LatticeKind>(reader.get<std::uint8_t>());
  const auto lattice_version = reader.get<std::uint8_t>();
  head.lattice.size = reader.get<std::uint32_t>();
  head.lattice.validate();
  if (lattice_version != kArchivedLatticeVersion) {
    throw Error(ErrorCode::kUnsupported, "the archive's lattice has version " +
                                             std::to_string(lattice_version) +
                                             ", but this build knows only version 1");
  }
  head.cells = reader.get<std::uint64_t>();
  head.records_end = reader.get<std::uint64_t>();
  head.data_end = reader.get<std::uint64_t>();
  head.root_bytes = reader.get<std::uint32_t>();
  const auto flags = reader.get<std::uint32_t>();
  head.has_leaves = flags == kHasLeaves;
  head.root_checksum = reader.get<std::uint64_t>();
  const bool finished = head.records_end != 0;
  if (flags > kHasLeaves || head.cells > kMaxArchiveCells ||
      head.root_bytes > kMaxArchiveRootBytes || head.data_end > kMaxArchiveBytes ||
      (finished && (head.records_end < kArchiveFirstReadBytes || head.root_bytes == 0)) ||
      head.data_end < head.records_end) {
    throw corrupt_layout("a number of its head is out of range");
  }
  return head;
}

Bytes encode_archive_state(const ArchiveState& state) {
  Bytes bytes;
  put(bytes, state.serial);
  put(bytes, state.block_offset);
  put(bytes, state.footer_offset);
  put(bytes, state.footer_bytes);
  put(bytes, state.footer_checksum);
  put(bytes, state.end);
  put(bytes, std::uint64_t{0});
  put(bytes, checksum(bytes));
  return bytes;
}

std::optional<ArchiveState> decode_archive_state(std::span<const std::byte> bytes) {
  if (!is_sealed(bytes, kArchiveStateBytes)) return std::nullopt;
  Reader reader(bytes);
  ArchiveState state;
  state.serial = reader.get<std::uint64_t>();
  state.block_offset = reader.get<std::uint64_t>();
  state.footer_offset = reader.get<std::uint64_t>();
  state.footer_bytes = reader.get<std::uint64_t>();
  state.footer_checksum = reader.get<std::uint64_t>();
  state.end = reader.get<std::uint64_t>();
  if (reader.get<std::uint64_t>() != 0 || !is_plausible(state)) return std::nullopt;
  return state;
}

Bytes encode_archive_tail(const ArchiveState& state) {
  Bytes bytes = encode_archive_state(state);
  put(bytes, kTailMagic);
  return bytes;
}

std::optional<ArchiveState> decode_archive_tail(std::span<const std::byte> bytes) {
  if (bytes.size() != kArchiveTailBytes) return std::nullopt;
  if (!begins_with(bytes.subspan(kArchiveStateBytes), kTailMagic)) return std::nullopt;
  return decode_archive_state(bytes);
}

Bytes encode_archive_record_header(const ArchiveRecordHeader& header) {
  Bytes bytes;
  put(bytes, kRecordMagic);
  put(bytes, header.cell.value);
  put(bytes, header.payload_bytes);
  put(bytes, header.payload_checksum);
  put(bytes, static_cast<std::uint32_t>(header.encoding));
  put(bytes, static_cast<std::uint32_t>(checksum(bytes)));
  return bytes;
}

std::optional<ArchiveRecordHeader> decode_archive_record_header(std::span<const std::byte> bytes) {
  if (bytes.size() < kArchiveRecordHeaderBytes || !begins_with(bytes, kRecordMagic)) {
    return std::nullopt;
  }
  Reader reader(bytes.subspan(kRecordMagic.size()));
  ArchiveRecordHeader header;
  header.cell.value = reader.get<std::uint32_t>();
  header.payload_bytes = reader.get<std::uint32_t>();
  header.payload_checksum = reader.get<std::uint64_t>();
  const auto encoding = reader.get<std::uint32_t>();
  header.encoding = static_cast<ArchiveEncoding>(encoding);
  const auto seal = static_cast<std::uint32_t>(checksum(bytes.first(28)));
  if (reader.get<std::uint32_t>() != seal || encoding < 1 || encoding > 3 ||
      header.payload_bytes > kMaxArchivePayloadBytes) {
    return std::nullopt;
  }
  return header;
}

}  // namespace cellmap
