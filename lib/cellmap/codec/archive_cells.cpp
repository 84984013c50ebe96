#include "cellmap/codec/archive_cells.hpp"

#include <array>
#include <cstring>

#include "cellmap/codec/cell_wire.hpp"
#include "cellmap/codec/pose_grid.hpp"
#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/codec/wire_columns.hpp"
#include "cellmap/schema/archive_generated.h"

namespace cellmap {
namespace {

constexpr std::size_t kMaxCellsTables = 4;
constexpr std::size_t kMaxScans = 1u << 24;
/// Scans whose columns are all zero take no bytes: so many may be, else memory had no bound.
constexpr std::size_t kMaxScansWithoutBytes = 1u << 16;
constexpr std::size_t kMaxScansPerCell = 100'000;
constexpr std::int64_t kMaxCount = 1'000'000'000'000'000;  // of points, as in a store
constexpr int kPoseColumns = 6;

constexpr BufferKind kCellsKind = {
    "archive's list of CELLs", "CACL", kMaxArchiveSectionBytes,
    [](flatbuffers::Verifier& v) { return v.VerifyBuffer<schema::ArchiveCells>("CACL"); }};
constexpr BufferKind kScansKind = {
    "archive's list of scans", "CASC", kMaxArchiveSectionBytes,
    [](flatbuffers::Verifier& v) { return v.VerifyBuffer<schema::ArchiveScans>("CASC"); }};

Error corrupt_cells(const std::string& what) {
  return Error(ErrorCode::kCorruptData, "a section of the archive is not valid: " + what);
}

Bytes finished(flatbuffers::FlatBufferBuilder& builder) {
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  return Bytes(begin, begin + builder.GetSize());
}

/// A column whose values lie in [0, max].
std::vector<std::int64_t> bounded_column(const WireColumn& wire, std::size_t count,
                                         std::int64_t max, const char* name) {
  auto values = column_from_wire(wire, count, name);
  for (const std::int64_t value : values) {
    if (value < 0 || value > max) {
      throw corrupt_cells(std::string("a value of '") + name + "' is " + std::to_string(value) +
                          ", expected 0 to " + std::to_string(max));
    }
  }
  return values;
}

std::int64_t& pose_column(GridPose& pose, int column) {
  return column < 3 ? pose.translation[column] : pose.rotation[column - 3];
}

std::vector<Pose> poses_of(const std::map<CellId, CellScans>& stretches) {
  std::vector<Pose> poses;
  for (const auto& [id, stretch] : stretches) poses.push_back(stretch.T_odom_cell);
  for (const auto& [id, stretch] : stretches) {
    for (const ScanInCell& scan : stretch.scans) poses.push_back(scan.T_cell_scan);
  }
  return poses;
}

/// All poses of the table, exact or on the grid.
std::vector<Pose> poses_from_wire(const schema::ArchiveScans& wire, std::size_t count) {
  std::vector<Pose> poses;
  if (const auto* exact = wire.poses()) {
    if (exact->size() != count) throw corrupt_cells("its poses are not as many as CELLs and scans");
    for (const schema::Pose* pose : *exact) poses.push_back(pose_from_wire(pose, "a scan's pose"));
    return poses;
  }
  const std::array<const WireColumn*, kPoseColumns> columns = {wire.x(),  wire.y(),  wire.z(),
                                                               wire.rx(), wire.ry(), wire.rz()};
  std::vector<GridPose> grid(count);
  for (int i = 0; i < kPoseColumns; ++i) {
    if (!columns[i]) throw corrupt_cells("a column of its poses is missing");
    const std::int64_t limit = i < 3 ? kMaxGridTranslation : kMaxGridRotation;
    const auto values = column_from_wire(*columns[i], count, "poses");
    for (std::size_t row = 0; row < values.size(); ++row) {
      if (values[row] < -limit || values[row] > limit)
        throw corrupt_cells("a pose is out of range");
      pose_column(grid[row], i) = values[row];
    }
  }
  for (const GridPose& pose : grid) poses.push_back(from_grid(pose));
  return poses;
}

}  // namespace

Bytes encode_archive_cells(std::span<const ArchivedCell> cells) {
  std::vector<std::int64_t> ids, sessions, sequences, planes, bytes;
  std::vector<schema::Hash256> hashes;
  for (const ArchivedCell& cell : cells) {
    ids.push_back(cell.id.value);
    hashes.push_back(hash_to_wire(cell.hash));
    sessions.push_back(cell.session);
    sequences.push_back(cell.sequence);
    planes.push_back(cell.planes);
    bytes.push_back(static_cast<std::int64_t>(cell.bytes));
  }
  flatbuffers::FlatBufferBuilder builder(1024 + 64 * cells.size());
  const auto wire_ids = column_to_wire(builder, ids);
  const auto wire_hashes = builder.CreateVectorOfStructs(hashes);
  const auto wire_sessions = column_to_wire(builder, sessions);
  const auto wire_sequences = column_to_wire(builder, sequences);
  const auto wire_planes = column_to_wire(builder, planes);
  const auto wire_bytes = column_to_wire(builder, bytes);
  builder.Finish(schema::CreateArchiveCells(
                     builder, kFormatVersion, static_cast<std::uint32_t>(cells.size()), wire_ids,
                     wire_hashes, wire_sessions, wire_sequences, wire_planes, wire_bytes),
                 "CACL");
  return finished(builder);
}

std::vector<ArchivedCell> decode_archive_cells(std::span<const std::byte> bytes,
                                               std::size_t sessions) {
  const Bytes copy = verified_copy(bytes, kCellsKind, kMaxCellsTables);
  const auto& wire = *flatbuffers::GetRoot<schema::ArchiveCells>(copy.data());
  const std::size_t count = wire.count();
  const auto ids = ids_of_column(*wire.cells(), count, kMaxArchiveCells, "cells");
  if (wire.hashes()->size() != count)
    throw corrupt_cells("its hashes are not as many as its CELLs");
  const auto last_session = static_cast<std::int64_t>(sessions) - 1;
  const auto session = bounded_column(*wire.session(), count, last_session, "session");
  const auto sequence = bounded_column(*wire.sequence(), count, UINT32_MAX, "sequence");
  const auto planes = bounded_column(*wire.planes(), count, UINT32_MAX, "planes");
  const auto sizes = bounded_column(*wire.bytes(), count, kMaxCellBytes, "bytes");
  std::vector<ArchivedCell> cells;
  for (std::size_t i = 0; i < count; ++i) {
    cells.push_back({CellId{ids[i]},
                     hash_from_wire(*wire.hashes()->Get(static_cast<flatbuffers::uoffset_t>(i))),
                     static_cast<std::uint32_t>(session[i]),
                     static_cast<std::uint32_t>(sequence[i]), static_cast<std::uint32_t>(planes[i]),
                     static_cast<std::uint64_t>(sizes[i])});
  }
  return cells;
}

Bytes encode_archive_scans(const std::map<CellId, CellScans>& stretches, bool exact) {
  std::vector<std::int64_t> ids, counts, raw_points, voxel_points, stamps;
  for (const auto& [id, stretch] : stretches) {
    ids.push_back(id.value);
    counts.push_back(static_cast<std::int64_t>(stretch.scans.size()));
    raw_points.push_back(static_cast<std::int64_t>(stretch.raw_points));
    voxel_points.push_back(static_cast<std::int64_t>(stretch.voxel_points));
    for (const ScanInCell& scan : stretch.scans) stamps.push_back(scan.stamp);
  }
  const std::vector<Pose> poses = poses_of(stretches);
  flatbuffers::FlatBufferBuilder builder(1024 + 128 * poses.size());
  const auto wire_ids = column_to_wire(builder, ids);
  const auto wire_counts = column_to_wire(builder, counts);
  const auto wire_raw = column_to_wire(builder, raw_points);
  const auto wire_voxel = column_to_wire(builder, voxel_points);
  const auto wire_stamps = column_to_wire(builder, stamps);
  flatbuffers::Offset<flatbuffers::Vector<const schema::Pose*>> wire_poses;
  std::array<flatbuffers::Offset<WireColumn>, kPoseColumns> columns;
  if (exact) {
    std::vector<schema::Pose> wire;
    for (const Pose& pose : poses) wire.push_back(pose_to_wire(pose));
    wire_poses = builder.CreateVectorOfStructs(wire);
  } else {
    std::array<std::vector<std::int64_t>, kPoseColumns> values;
    for (const Pose& pose : poses) {
      GridPose grid = to_grid(pose);
      for (int i = 0; i < kPoseColumns; ++i) values[i].push_back(pose_column(grid, i));
    }
    for (int i = 0; i < kPoseColumns; ++i) columns[i] = column_to_wire(builder, values[i]);
  }
  builder.Finish(schema::CreateArchiveScans(
                     builder, kFormatVersion, static_cast<std::uint32_t>(ids.size()), wire_ids,
                     wire_counts, wire_raw, wire_voxel, wire_stamps, wire_poses, columns[0],
                     columns[1], columns[2], columns[3], columns[4], columns[5]),
                 "CASC");
  return finished(builder);
}

std::map<CellId, CellScans> decode_archive_scans(std::span<const std::byte> bytes) {
  const Bytes copy = verified_copy(bytes, kScansKind, kMaxCellsTables);
  const auto& wire = *flatbuffers::GetRoot<schema::ArchiveScans>(copy.data());
  const std::size_t count = wire.count();
  const auto ids = ids_of_column(*wire.cells(), count, kMaxArchiveCells, "cells");
  const auto counts = bounded_column(*wire.scans(), count, kMaxScansPerCell, "scans");
  const auto raw_points = bounded_column(*wire.raw_points(), count, kMaxCount, "raw_points");
  const auto voxels = bounded_column(*wire.voxel_points(), count, kMaxCount, "voxel_points");
  std::size_t scans = 0;
  for (const std::int64_t n : counts) {
    scans += static_cast<std::size_t>(n);
    if (scans > kMaxScans || scans > kMaxScansWithoutBytes + bytes.size()) {
      throw Error(ErrorCode::kTooLarge, "an archive has at most " + std::to_string(kMaxScans) +
                                            " scans, and about a byte for each");
    }
  }
  const auto stamps = column_from_wire(*wire.stamps(), scans, "stamps");
  const std::vector<Pose> poses = poses_from_wire(wire, count + scans);
  std::map<CellId, CellScans> stretches;
  std::size_t row = 0;
  for (std::size_t i = 0; i < count; ++i) {
    CellScans stretch;
    stretch.cell.value = ids[i];
    stretch.T_odom_cell = poses[i];
    stretch.raw_points = static_cast<std::uint64_t>(raw_points[i]);
    stretch.voxel_points = static_cast<std::uint64_t>(voxels[i]);
    for (std::int64_t k = 0; k < counts[i]; ++k, ++row) {
      stretch.scans.push_back({stamps[row], poses[count + row]});
    }
    stretches.emplace_hint(stretches.end(), stretch.cell, std::move(stretch));
  }
  return stretches;
}

}  // namespace cellmap
