#include "cellmap/codec/drive_part_codec.hpp"

#include <cstring>
#include <string>

#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/drive_part_generated.h"

namespace cellmap {
namespace {

constexpr BufferKind kDrivePartKind = {
    "part of a drive", "CPRT", kMaxDrivePartBytes,
    [](flatbuffers::Verifier& v) { return schema::VerifyDrivePartBuffer(v); }};

[[noreturn]] void refuse_part(const std::string& what) {
  throw Error(ErrorCode::kCorruptData, "the bytes are no part of a drive: " + what);
}

void check_part_size(std::size_t cells) {
  if (cells <= kMaxDrivePartCells) return;
  throw Error(ErrorCode::kTooLarge, "a part of a drive has at most " +
                                        std::to_string(kMaxDrivePartCells) + " CELLs, but " +
                                        std::to_string(cells) + " were found");
}

flatbuffers::Offset<schema::DrivePartCell> made_cell_to_wire(
    flatbuffers::FlatBufferBuilder& builder, const MadeCell& made) {
  std::vector<std::int64_t> stamps;
  std::vector<schema::Pose> poses;
  for (const ScanInCell& scan : made.scans) {
    stamps.push_back(scan.stamp);
    poses.push_back(pose_to_wire(scan.T_cell_scan));
  }
  std::vector<std::uint64_t> keys, voxels;
  for (const VoxelBlock& block : made.voxels) {
    keys.push_back(block.key);
    voxels.push_back(block.occupied);
  }
  const Bytes cell = encode_cell(*made.cell).bytes;
  const auto wire_cell =
      builder.CreateVector(reinterpret_cast<const std::uint8_t*>(cell.data()), cell.size());
  const auto wire_stamps = builder.CreateVector(stamps);
  const auto wire_poses = builder.CreateVectorOfStructs(poses);
  const auto wire_keys = builder.CreateVector(keys);
  const auto wire_voxels = builder.CreateVector(voxels);
  return schema::CreateDrivePartCell(builder, wire_cell, wire_stamps, wire_poses, made.raw_points,
                                     wire_keys, wire_voxels);
}

/// The verifier does not check the alignment of numbers in vectors.
template <typename Number>
std::vector<Number> copied_numbers(const flatbuffers::Vector<Number>& wire) {
  std::vector<Number> numbers(wire.size());
  if (!numbers.empty()) std::memcpy(numbers.data(), wire.Data(), numbers.size() * sizeof(Number));
  return numbers;
}

std::vector<ScanInCell> scans_from_wire(const schema::DrivePartCell& wire) {
  const std::size_t count = wire.stamps_ns()->size();
  if (count == 0 || wire.t_cell_scan()->size() != count) {
    refuse_part("expected a time and a pose for every scan, found " + std::to_string(count) +
                " and " + std::to_string(wire.t_cell_scan()->size()));
  }
  const auto stamps = copied_numbers(*wire.stamps_ns());
  std::vector<ScanInCell> scans(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto* T = wire.t_cell_scan()->Get(static_cast<flatbuffers::uoffset_t>(i));
    scans[i] = {stamps[i], pose_from_wire(T, "the pose of a scan in its CELL")};
  }
  return scans;
}

std::vector<VoxelBlock> voxels_from_wire(const schema::DrivePartCell& wire) {
  const std::size_t count = wire.voxel_keys()->size();
  if (wire.voxels()->size() != count) refuse_part("its voxels and their keys differ in number");
  const auto keys = copied_numbers(*wire.voxel_keys());
  const auto voxels = copied_numbers(*wire.voxels());
  std::vector<VoxelBlock> blocks(count);
  for (std::size_t i = 0; i < count; ++i) {
    blocks[i] = {keys[i], voxels[i]};
    const bool ascends = i == 0 || blocks[i].key > blocks[i - 1].key;
    if (!ascends || blocks[i].key >= kVoxelKeys) refuse_part("the keys of its voxels are damaged");
  }
  return blocks;
}

MadeCell made_cell_from_wire(const schema::DrivePartCell& wire) {
  const auto* bytes = reinterpret_cast<const std::byte*>(wire.cell()->data());
  MadeCell made;
  made.cell = std::make_shared<const Cell>(decode_cell({bytes, wire.cell()->size()}));
  made.scans = scans_from_wire(wire);
  if (made.scans.size() != made.cell->scan_count) {
    refuse_part("a CELL of " + std::to_string(made.cell->scan_count) + " scans has " +
                std::to_string(made.scans.size()) + " of them");
  }
  made.raw_points = wire.raw_points();
  made.voxels = voxels_from_wire(wire);
  return made;
}

}  // namespace

Bytes encode_drive_part(std::span<const MadeCell> cells) {
  check_part_size(cells.size());
  flatbuffers::FlatBufferBuilder builder(1u << 20);
  std::vector<flatbuffers::Offset<schema::DrivePartCell>> wire;
  for (const MadeCell& cell : cells) {
    // Two gigabytes are too many for the builder; each of these is far smaller.
    if (builder.GetSize() > kMaxDrivePartBytes) break;
    wire.push_back(made_cell_to_wire(builder, cell));
  }
  const auto all = builder.CreateVector(wire);
  schema::FinishDrivePartBuffer(builder, schema::CreateDrivePart(builder, kFormatVersion, all));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  check_size({begin, builder.GetSize()}, kDrivePartKind);
  return Bytes(begin, begin + builder.GetSize());
}

std::vector<MadeCell> decode_drive_part(std::span<const std::byte> bytes) {
  const Bytes copy = verified_copy(bytes, kDrivePartKind, 2 * kMaxDrivePartCells);
  const auto& wire = *schema::GetDrivePart(copy.data())->cells();
  check_part_size(wire.size());
  std::vector<MadeCell> cells;
  for (const schema::DrivePartCell* cell : wire) cells.push_back(made_cell_from_wire(*cell));
  return cells;
}

}  // namespace cellmap
