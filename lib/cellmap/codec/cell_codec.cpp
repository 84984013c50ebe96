#include "cellmap/codec/cell_codec.hpp"

#include <array>
#include <cstring>
#include <string>

#include "cellmap/codec/cell_wire.hpp"
#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/cell_generated.h"

namespace cellmap {
namespace {

static_assert(sizeof(schema::Plane) == sizeof(Plane),
              "a struct of the format has changed: every file would become unreadable");

constexpr std::size_t kMaxTables = 64;
constexpr BufferKind kCellKind = {"CELL", "CELL", kMaxCellBytes, [](flatbuffers::Verifier& v) {
                                    return schema::VerifyCellBuffer(v);
                                  }};

const schema::Cell& root(std::span<const std::byte> bytes) {
  return *schema::GetCell(bytes.data());
}

template <typename Value, typename WireVector>
std::span<const Value> span_of(const WireVector& wire) {
  // The verifier does not check the alignment of structs in vectors, but that of a vector's length,
  // which is all that four-byte members need.
  static_assert(alignof(Value) == sizeof(std::uint32_t));
  return {reinterpret_cast<const Value*>(wire.Data()), wire.size()};
}

flatbuffers::Offset<schema::Cell> cell_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                               const Cell& cell) {
  // The order of these lines is the order of the bytes: FORMAT.md, "How the library lays out a
  // CELL".
  schema::Plane* planes_begin = nullptr;
  const auto planes =
      builder.CreateUninitializedVectorOfStructs<schema::Plane>(cell.planes.size(), &planes_begin);
  if (!cell.planes.empty()) {
    std::memcpy(static_cast<void*>(planes_begin), cell.planes.data(),
                cell.planes.size() * sizeof(Plane));
  }
  const auto indices = builder.CreateVector(cell.indices);
  const auto session = builder.CreateString(cell.session);
  const auto lattice = lattice_to_wire(builder, cell.lattice);
  const auto statistics = statistics_to_wire(builder, cell.statistics);
  const schema::Hash256 no_hash_yet;
  const schema::Pose T_odom_cell = pose_to_wire(cell.T_odom_cell);
  return schema::CreateCell(builder, kFormatVersion, &no_hash_yet, lattice, indices, planes,
                            session, cell.sequence, &T_odom_cell, cell.first_stamp, cell.last_stamp,
                            cell.first_scan, cell.scan_count, statistics);
}

/// A CELL whose bytes `verify_buffer` holds for and whose hash is `hash`.
CellView view_with_hash(std::span<const std::byte> bytes, const ContentHash& hash) {
  const schema::Cell& wire = root(bytes);
  CellView view;
  view.hash = hash;
  view.header = header_from_wire(wire);
  view.indices = span_of<std::uint32_t>(*wire.indices());
  view.planes = span_of<Plane>(*wire.planes());
  validate(view.header);
  validate_planes(view.header.lattice, view.indices, view.planes);
  return view;
}

}  // namespace

EncodedCell encode_cell(const Cell& cell) {
  cell.lattice.validate();
  validate(cell);
  flatbuffers::FlatBufferBuilder builder(1024 + 20 * cell.planes.size());
  schema::FinishCellBuffer(builder, cell_to_wire(builder, cell));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  EncodedCell encoded{.hash = {}, .bytes = Bytes(begin, begin + builder.GetSize())};
  encoded.hash = write_hash(encoded.bytes, *root(encoded.bytes).content_hash());
  return encoded;
}

Cell CellView::to_cell() const {
  Cell cell = header;
  cell.indices.assign(indices.begin(), indices.end());
  cell.planes.assign(planes.begin(), planes.end());
  return cell;
}

CellView view_cell(std::span<const std::byte> bytes) {
  if (!is_aligned(bytes)) {
    throw Error(ErrorCode::kInvalidArgument,
                "a CELL is read where it lies only from an address that is a multiple of 8");
  }
  verify_buffer(bytes, kCellKind, kMaxTables);
  return view_with_hash(bytes, check_hash(bytes, *root(bytes).content_hash(), kCellKind.name));
}

Cell decode_cell(std::span<const std::byte> bytes) {
  if (is_aligned(bytes)) return view_cell(bytes).to_cell();
  check_size(bytes, kCellKind);  // before so much is copied
  return view_cell(Bytes(bytes.begin(), bytes.end())).to_cell();
}

Cell decode_stored_cell(std::span<const std::byte> frame) {
  const Bytes bytes = zstd_decompress(frame, kMaxCellBytes);
  verify_buffer(bytes, kCellKind, kMaxTables);
  return view_with_hash(bytes, hash_from_wire(*root(bytes).content_hash())).to_cell();
}

ContentHash verified_hash(std::span<const std::byte> bytes) {
  if (!is_aligned(bytes)) return verified_hash(verified_copy(bytes, kCellKind, kMaxTables));
  verify_buffer(bytes, kCellKind, kMaxTables);
  return check_hash(bytes, *root(bytes).content_hash(), kCellKind.name);
}

}  // namespace cellmap
