#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/cell_form.hpp"
#include "cellmap/core/id.hpp"
#include "cellmap/geometry/lattice.hpp"

namespace cellmap {

// The parts of an archive that lie at fixed places or have a fixed size (FORMAT.md, "Archive").
// All of them carry a checksum of their own; everything else is named by one of them.
//
//   0      ArchiveHead       written once
//   512    ArchiveState      two slots, written in turn: the valid one with the higher serial says
//   1024   ArchiveState      where the newest footer is
//   1536   root directory    up to 16384
//   16384  records           one a CELL, at multiples of 8, never moved
//          leaf directories  where the root does not hold all CELLs
//          sections, footer, tail                   and again for each update

constexpr std::uint64_t kArchiveFirstReadBytes = 16384;  ///< head, states and root directory
constexpr std::uint64_t kArchiveHeadBytes = 64;
constexpr std::uint64_t kArchiveStateBytes = 64;
constexpr std::array<std::uint64_t, 2> kArchiveStateOffsets = {512, 1024};
constexpr std::uint64_t kArchiveRootOffset = 1536;
constexpr std::uint64_t kMaxArchiveRootBytes = kArchiveFirstReadBytes - kArchiveRootOffset;
constexpr std::uint64_t kArchiveRecordHeaderBytes = 32;
constexpr std::uint64_t kArchiveTailBytes = kArchiveStateBytes + 8;  ///< a state, then the magic
constexpr std::uint64_t kArchiveAlignment = 8;

/// Limits. An archive has at most 2^20 CELLs and 2^42 bytes.
constexpr std::uint64_t kMaxArchiveBytes = 1ull << 42;
constexpr std::size_t kMaxArchiveCells = 1u << 20;
constexpr std::size_t kMaxArchivePayloadBytes = kMaxCellBytes + (1u << 20);

/// The next multiple of 8.
constexpr std::uint64_t aligned_up(std::uint64_t offset) {
  return (offset + kArchiveAlignment - 1) / kArchiveAlignment * kArchiveAlignment;
}

using ArchiveEncoding = KeptEncoding;

/// Inverse of `to_string`; Error{kInvalidArgument} for anything else.
ArchiveEncoding archive_encoding_from_string(std::string_view name);

struct ArchiveHead {
  LatticeSpec lattice;
  std::uint64_t cells = 0;
  std::uint64_t records_end = 0;  ///< of the last record; 0: the writer has not finished
  std::uint64_t data_end = 0;     ///< of the leaf directories: what comes before never moves
  std::uint32_t root_bytes = 0;
  bool has_leaves = false;  ///< the root names leaf directories, not CELLs
  std::uint64_t root_checksum = 0;
  bool operator==(const ArchiveHead&) const = default;
};

/// Which footer is the newest.
struct ArchiveState {
  std::uint64_t serial = 0;        ///< from 1, one more with each update
  std::uint64_t block_offset = 0;  ///< what was written with this footer begins here
  std::uint64_t footer_offset = 0;
  std::uint64_t footer_bytes = 0;
  std::uint64_t footer_checksum = 0;
  std::uint64_t end = 0;  ///< of the tail; bytes behind it are an update that was not finished
  bool operator==(const ArchiveState&) const = default;
};

struct ArchiveRecordHeader {
  CellId cell;
  std::uint32_t payload_bytes = 0;
  std::uint64_t payload_checksum = 0;
  ArchiveEncoding encoding = ArchiveEncoding::kRaw;
  bool operator==(const ArchiveRecordHeader&) const = default;
};

Bytes encode_archive_head(const ArchiveHead& head);
/// Throws Error{kCorruptData} where the bytes are no head or fail their checksum, {kUnsupported}
/// for another version or lattice.
ArchiveHead decode_archive_head(std::span<const std::byte> bytes);

/// `kArchiveStateBytes` bytes.
Bytes encode_archive_state(const ArchiveState& state);
/// Nullopt where the bytes are no valid state; an empty slot is none.
std::optional<ArchiveState> decode_archive_state(std::span<const std::byte> bytes);

/// The last bytes of an archive: a copy of its state, then the magic number.
Bytes encode_archive_tail(const ArchiveState& state);
/// Of the last `kArchiveTailBytes` bytes; nullopt where they are no tail.
std::optional<ArchiveState> decode_archive_tail(std::span<const std::byte> bytes);

Bytes encode_archive_record_header(const ArchiveRecordHeader& header);
/// Nullopt where there is none: how records are found when the directory is gone.
std::optional<ArchiveRecordHeader> decode_archive_record_header(std::span<const std::byte> bytes);

}  // namespace cellmap
