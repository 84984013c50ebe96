#include "cellmap/codec/archive_directory.hpp"

#include <string>

#include "cellmap/codec/byte_planes.hpp"
#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/codec/wire_columns.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/archive_generated.h"

namespace cellmap {
namespace {

constexpr char kDirectoryIdentifier[] = "CADR";
constexpr std::size_t kMaxBytes = 32u << 20;
constexpr std::size_t kMaxDirectoryTables = 4;
constexpr BufferKind kDirectoryKind = {
    "archive directory", kDirectoryIdentifier, kMaxBytes, [](flatbuffers::Verifier& v) {
      return v.VerifyBuffer<schema::ArchiveDirectory>(kDirectoryIdentifier);
    }};
constexpr int kLevel = 19;

Error corrupt_directory(const std::string& what) {
  return Error(ErrorCode::kCorruptData, "a directory of the archive is damaged: " + what);
}

}  // namespace

Bytes encode_archive_directory(std::span<const ArchiveEntry> entries, std::uint64_t begin,
                               bool of_leaves) {
  std::vector<std::int64_t> cells, gaps, lengths;
  std::vector<std::uint64_t> checksums;
  for (const ArchiveEntry& entry : entries) {
    cells.push_back(entry.cell.value);
    gaps.push_back(static_cast<std::int64_t>((entry.offset - begin) / kArchiveAlignment));
    lengths.push_back(entry.bytes);
    checksums.push_back(entry.checksum);
    begin = entry.end();
  }
  flatbuffers::FlatBufferBuilder builder(1024 + 16 * entries.size());
  const auto wire_cells = column_to_wire(builder, cells);
  const auto wire_gaps = column_to_wire(builder, gaps);
  const auto wire_lengths = column_to_wire(builder, lengths);
  flatbuffers::Offset<flatbuffers::Vector<std::uint64_t>> wire_checksums;
  if (of_leaves) wire_checksums = builder.CreateVector(checksums);
  builder.Finish(schema::CreateArchiveDirectory(
                     builder, kFormatVersion, static_cast<std::uint32_t>(entries.size()),
                     wire_cells, wire_gaps, wire_lengths, wire_checksums),
                 kDirectoryIdentifier);
  return zstd_compress(std::as_bytes(std::span(builder.GetBufferPointer(), builder.GetSize())),
                       kLevel);
}

std::vector<ArchiveEntry> decode_archive_directory(std::span<const std::byte> frame,
                                                   std::uint64_t begin, std::uint64_t end,
                                                   bool of_leaves) {
  const Bytes bytes = zstd_decompress(frame, kMaxBytes);
  verify_buffer(bytes, kDirectoryKind, kMaxDirectoryTables);
  const auto& wire = *flatbuffers::GetRoot<schema::ArchiveDirectory>(bytes.data());
  const std::size_t count = wire.count();
  const auto cells = ids_of_column(*wire.cells(), count, kMaxArchiveCells, "cells");
  const auto gaps = column_from_wire(*wire.gaps(), count, "gaps");
  const auto lengths = column_from_wire(*wire.lengths(), count, "lengths");
  const auto* checksums = wire.checksums();
  if (of_leaves != (checksums != nullptr) || (checksums && checksums->size() != count)) {
    throw corrupt_directory("its checksums are not as many as its rows");
  }
  std::vector<ArchiveEntry> entries;
  for (std::size_t i = 0; i < count; ++i) {
    const bool in_range = gaps[i] >= 0 && lengths[i] > 0 && lengths[i] <= UINT32_MAX &&
                          static_cast<std::uint64_t>(gaps[i]) <= (end - begin) / kArchiveAlignment;
    ArchiveEntry entry;
    entry.cell.value = cells[i];
    if (in_range) {
      entry.offset = begin + static_cast<std::uint64_t>(gaps[i]) * kArchiveAlignment;
      entry.bytes = static_cast<std::uint32_t>(lengths[i]);
      if (checksums) entry.checksum = checksums->Get(static_cast<flatbuffers::uoffset_t>(i));
    }
    if (!in_range || entry.end() > end) {
      throw corrupt_directory("it says that CELL " + std::to_string(cells[i]) +
                              " lies outside of the data");
    }
    begin = entry.end();
    entries.push_back(entry);
  }
  return entries;
}

}  // namespace cellmap
