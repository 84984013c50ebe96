#include "cellmap/codec/coded_cell.hpp"

#include <cmath>
#include <string>

#include "cellmap/codec/cell_wire.hpp"
#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/codec/packed_planes.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/coded_cell_generated.h"

namespace cellmap {
namespace {

constexpr std::size_t kMaxTables = 64;
constexpr double kMicro = 1e-6;
constexpr BufferKind kCodedKind = {
    "coded CELL", "CCOD", kMaxCodedCellBytes,
    [](flatbuffers::Verifier& v) { return schema::VerifyCodedCellBuffer(v); }};

const schema::CodedCell& root(std::span<const std::byte> bytes) {
  return *schema::GetCodedCell(bytes.data());
}

EncodedCell to_file(const Cell& cell, const ContentHash& raw_hash, CellEncoding encoding,
                    std::uint32_t bound_um, const Bytes& data) {
  flatbuffers::FlatBufferBuilder builder(1024 + data.size());
  const auto coded =
      builder.CreateVector(reinterpret_cast<const std::uint8_t*>(data.data()), data.size());
  const auto session = builder.CreateString(cell.session);
  const auto lattice = lattice_to_wire(builder, cell.lattice);
  const auto statistics = statistics_to_wire(builder, cell.statistics);
  const schema::Hash256 no_hash_yet, raw = hash_to_wire(raw_hash);
  const schema::Pose T_odom_cell = pose_to_wire(cell.T_odom_cell);
  schema::FinishCodedCellBuffer(
      builder,
      schema::CreateCodedCell(builder, kFormatVersion, &no_hash_yet, &raw,
                              static_cast<schema::Encoding>(encoding), bound_um, lattice,
                              static_cast<std::uint32_t>(cell.planes.size()), coded, session,
                              cell.sequence, &T_odom_cell, cell.first_stamp, cell.last_stamp,
                              cell.first_scan, cell.scan_count, statistics));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  EncodedCell encoded{.hash = {}, .bytes = Bytes(begin, begin + builder.GetSize())};
  encoded.hash = write_hash(encoded.bytes, *root(encoded.bytes).content_hash());
  return encoded;
}

/// Throws unless the fields that say how to decode are those of an encoder.
void check_coding(const schema::CodedCell& wire, const Lattice& lattice) {
  const auto encoding = static_cast<CellEncoding>(wire.encoding());
  if (encoding != CellEncoding::kPacked && encoding != CellEncoding::kCompact) {
    throw Error(ErrorCode::kUnsupported, "the coded CELL has the encoding " +
                                             std::to_string(int(wire.encoding())) +
                                             ", but this build knows 1 (packed) and 2 (compact)");
  }
  const double bound_m = wire.bound_um() * kMicro;
  const bool is_bound_right = encoding == CellEncoding::kPacked
                                  ? wire.bound_um() == 0
                                  : bound_m >= kMinCompactBoundM && bound_m <= kMaxCompactBoundM;
  if (!is_bound_right) {
    throw Error(ErrorCode::kCorruptData, "the coded CELL has a bound of " +
                                             std::to_string(wire.bound_um()) +
                                             " um; expected 1,000 to 1,000,000, and 0 if packed");
  }
  if (wire.plane_count() > lattice.size()) {
    throw Error(ErrorCode::kCorruptData,
                "the coded CELL has " + std::to_string(wire.plane_count()) +
                    " planes, but its lattice has " + std::to_string(lattice.size()) + " points");
  }
}

DecodedCell decode_aligned(std::span<const std::byte> bytes) {
  verify_buffer(bytes, kCodedKind, kMaxTables);
  const schema::CodedCell& wire = root(bytes);
  DecodedCell decoded;
  decoded.hash = check_hash(bytes, *wire.content_hash(), kCodedKind.name);
  decoded.raw_hash = hash_from_wire(*wire.raw_hash());
  decoded.encoding = static_cast<CellEncoding>(wire.encoding());
  decoded.bound_m = wire.bound_um() * kMicro;
  decoded.cell = header_from_wire(wire);
  const LatticeSpec spec = decoded.cell.lattice;
  check_coding(wire, Lattice(spec));
  const std::span data(reinterpret_cast<const std::byte*>(wire.data()->data()),
                       wire.data()->size());
  DecodedPlanes planes =
      decoded.encoding == CellEncoding::kPacked
          ? decode_packed_planes(spec, wire.plane_count(), data)
          : decode_compact_planes(spec, wire.plane_count(), data, decoded.bound_m);
  decoded.cell.indices = std::move(planes.indices);
  decoded.cell.planes = std::move(planes.planes);
  validate(decoded.cell);
  return decoded;
}

}  // namespace

EncodedCell encode_packed_cell(const Cell& cell) {
  const ContentHash raw_hash = encode_cell(cell).hash;
  return to_file(cell, raw_hash, CellEncoding::kPacked, 0,
                 encode_packed_planes(cell.lattice, cell.indices, cell.planes));
}

EncodedCell encode_compact_cell(const Cell& cell, double bound_m) {
  if (!(bound_m >= kMinCompactBoundM && bound_m <= kMaxCompactBoundM)) {
    throw Error(ErrorCode::kInvalidArgument,
                "the bound of a compact CELL must be 0.001 to 1 m, not " + std::to_string(bound_m));
  }
  const ContentHash raw_hash = encode_cell(cell).hash;
  const auto bound_um = static_cast<std::uint32_t>(std::floor(bound_m / kMicro + 1e-3));
  return to_file(cell, raw_hash, CellEncoding::kCompact, bound_um,
                 encode_compact_planes(cell.lattice, cell.indices, cell.planes, bound_um * kMicro));
}

DecodedCell decode_coded_cell(std::span<const std::byte> bytes) {
  check_size(bytes, kCodedKind);
  DecodedCell decoded =
      is_aligned(bytes) ? decode_aligned(bytes) : decode_aligned(Bytes(bytes.begin(), bytes.end()));
  if (decoded.encoding == CellEncoding::kPacked &&
      encode_cell(decoded.cell).hash != decoded.raw_hash) {
    throw Error(ErrorCode::kCorruptData,
                "the packed CELL is not the one that it names: unpacked it has another hash than " +
                    to_hex(decoded.raw_hash));
  }
  return decoded;
}

}  // namespace cellmap
