#include "cellmap/codec/cell_codec.hpp"

#include <array>
#include <cstring>
#include <string>

#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/cell_generated.h"

namespace cellmap {
namespace {

static_assert(sizeof(schema::Plane) == sizeof(Plane),
              "a struct of the format has changed: every file would become unreadable");

constexpr std::uint8_t kLatticeVersion = 1;  // of every kind
constexpr std::size_t kMaxTables = 64;
constexpr BufferKind kCellKind = {"CELL", "CELL", kMaxCellBytes, [](flatbuffers::Verifier& v) {
                                    return schema::VerifyCellBuffer(v);
                                  }};

const schema::Cell& root(std::span<const std::byte> bytes) {
  return *schema::GetCell(bytes.data());
}

std::size_t hash_offset(std::span<const std::byte> bytes) {
  const auto* hash = reinterpret_cast<const std::byte*>(root(bytes).content_hash());
  return static_cast<std::size_t>(hash - bytes.data());
}

/// SHA-256 of the bytes with zeros in place of their own hash.
ContentHash hash_of(std::span<const std::byte> bytes) {
  constexpr std::array<std::byte, sizeof(ContentHash)> kZeros{};
  const std::size_t offset = hash_offset(bytes);
  return sha256_of_pieces({bytes.first(offset), kZeros, bytes.subspan(offset + kZeros.size())});
}

ContentHash claimed_hash(std::span<const std::byte> bytes) {
  ContentHash claimed;
  std::memcpy(claimed.bytes.data(), bytes.data() + hash_offset(bytes), sizeof(claimed));
  return claimed;
}

ContentHash check_hash(std::span<const std::byte> bytes) {
  const ContentHash claimed = claimed_hash(bytes);
  const ContentHash actual = hash_of(bytes);
  if (claimed != actual) {
    throw Error(ErrorCode::kCorruptData, "the CELL is damaged: it claims the content hash " +
                                             to_hex(claimed) + ", but its bytes have " +
                                             to_hex(actual));
  }
  return actual;
}

static_assert(int(schema::LatticeKind::Fibonacci) == int(LatticeKind::kFibonacci) &&
                  int(schema::LatticeKind::FibonacciBands) == int(LatticeKind::kFibonacciBands),
              "both are the format's numbers");

LatticeSpec lattice_from_wire(const schema::Lattice& wire) {
  const LatticeSpec spec{static_cast<LatticeKind>(wire.kind()), wire.size()};
  spec.validate();
  if (wire.version() != kLatticeVersion) {
    throw Error(ErrorCode::kUnsupported, "the CELL's lattice " + to_string(spec) + " has version " +
                                             std::to_string(wire.version()) +
                                             ", but this build knows only version " +
                                             std::to_string(kLatticeVersion));
  }
  return spec;
}

CellStatistics statistics_from_wire(const schema::Statistics* wire) {
  if (!wire) return {};
  return {.points = wire->points(),
          .points_in_planes = wire->points_in_planes(),
          .patches_hit = wire->patches_hit(),
          .rejected_few_points = wire->rejected_few_points(),
          .rejected_gap = wire->rejected_gap(),
          .rejected_planarity = wire->rejected_planarity(),
          .rejected_grazing = wire->rejected_grazing()};
}

template <typename Value, typename WireVector>
std::span<const Value> span_of(const WireVector& wire) {
  // The verifier does not check the alignment of structs in vectors, but that of a vector's length,
  // which is all that four-byte members need.
  static_assert(alignof(Value) == sizeof(std::uint32_t));
  return {reinterpret_cast<const Value*>(wire.Data()), wire.size()};
}

Cell header_from_wire(const schema::Cell& wire) {
  Cell cell;
  cell.lattice = lattice_from_wire(*wire.lattice());
  cell.session = wire.session()->str();
  cell.sequence = wire.sequence();
  cell.T_odom_cell = pose_from_wire(wire.t_odom_cell(), "the CELL's pose T_odom_cell");
  cell.first_stamp = wire.first_stamp_ns();
  cell.last_stamp = wire.last_stamp_ns();
  cell.first_scan = wire.first_scan();
  cell.scan_count = wire.scan_count();
  cell.statistics = statistics_from_wire(wire.statistics());
  return cell;
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
  const auto lattice =
      schema::CreateLattice(builder, static_cast<schema::LatticeKind>(cell.lattice.kind),
                            kLatticeVersion, cell.lattice.size);
  const CellStatistics& s = cell.statistics;
  const auto statistics = schema::CreateStatistics(
      builder, s.points, s.points_in_planes, s.patches_hit, s.rejected_few_points, s.rejected_gap,
      s.rejected_planarity, s.rejected_grazing);
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
  encoded.hash = hash_of(encoded.bytes);
  std::memcpy(encoded.bytes.data() + hash_offset(encoded.bytes), encoded.hash.bytes.data(),
              sizeof(ContentHash));
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
  return view_with_hash(bytes, check_hash(bytes));
}

Cell decode_cell(std::span<const std::byte> bytes) {
  if (is_aligned(bytes)) return view_cell(bytes).to_cell();
  check_size(bytes, kCellKind);  // before so much is copied
  return view_cell(Bytes(bytes.begin(), bytes.end())).to_cell();
}

Cell decode_stored_cell(std::span<const std::byte> frame) {
  const Bytes bytes = zstd_decompress(frame, kMaxCellBytes);
  verify_buffer(bytes, kCellKind, kMaxTables);
  return view_with_hash(bytes, claimed_hash(bytes)).to_cell();
}

ContentHash verified_hash(std::span<const std::byte> bytes) {
  if (!is_aligned(bytes)) return check_hash(verified_copy(bytes, kCellKind, kMaxTables));
  verify_buffer(bytes, kCellKind, kMaxTables);
  return check_hash(bytes);
}

}  // namespace cellmap
