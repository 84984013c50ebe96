#include "cellmap/codec/coded_cell.hpp"

#include <cmath>
#include <memory>
#include <string>

#include "cellmap/codec/cell_wire.hpp"
#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/codec/packed_planes.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/coded_cell_generated.h"

namespace cellmap {
namespace {

constexpr std::size_t kMaxCodedTables = 64;
constexpr double kMetresPerUm = 1e-6;
constexpr BufferKind kCodedKind = {
    "coded CELL", "CCOD", kMaxCodedCellBytes,
    [](flatbuffers::Verifier& v) { return schema::VerifyCodedCellBuffer(v); }};

const schema::CodedCell& coded_root(std::span<const std::byte> bytes) {
  return *schema::GetCodedCell(bytes.data());
}

/// Bytes before `data`, which is the last thing in the file.
std::size_t bytes_before_data(std::span<const std::byte> bytes, const schema::CodedCell& wire) {
  return static_cast<std::size_t>(reinterpret_cast<const std::byte*>(wire.data()->data()) -
                                  bytes.data());
}

/// What the file says of how to read it.
schema::Encoding encoding_to_wire(CellEncoding encoding) {
  return encoding == CellEncoding::kPacked ? schema::Encoding::Packed : schema::Encoding::Compact2;
}

CellEncoding encoding_from_wire(schema::Encoding encoding) {
  switch (encoding) {
    case schema::Encoding::Packed:
      return CellEncoding::kPacked;
    case schema::Encoding::Compact:
    case schema::Encoding::Compact2:
      return CellEncoding::kCompact;
    default:
      throw Error(ErrorCode::kUnsupported,
                  "the coded CELL has the encoding " + std::to_string(int(encoding)) +
                      ", but this build knows 1 (packed), 2 and 3 (compact)");
  }
}

EncodedCell to_file(const Cell& cell, CellEncoding encoding, std::uint32_t bound_um,
                    const CodedLayers& layers) {
  const ContentHash raw_hash = encode_cell(cell).hash;
  Bytes data = layers[0].bytes;
  data.insert(data.end(), layers[1].bytes.begin(), layers[1].bytes.end());
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
      schema::CreateCodedCell(
          builder, kFormatVersion, &no_hash_yet, &no_hash_yet, &raw, encoding_to_wire(encoding),
          bound_um, lattice, static_cast<std::uint32_t>(cell.planes.size()),
          static_cast<std::uint32_t>(layers[0].planes),
          static_cast<std::uint32_t>(layers[0].bytes.size()), session, cell.sequence, &T_odom_cell,
          cell.first_stamp, cell.last_stamp, cell.first_scan, cell.scan_count, statistics, coded));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  EncodedCell encoded{.hash = {}, .bytes = Bytes(begin, begin + builder.GetSize())};
  const schema::CodedCell& wire = coded_root(encoded.bytes);
  const std::size_t coarse = bytes_before_data(encoded.bytes, wire) + layers[0].bytes.size();
  write_hash_without(std::span(encoded.bytes).first(coarse), *wire.coarse_hash(),
                     *wire.content_hash());
  encoded.hash = write_hash(encoded.bytes, *wire.content_hash());
  return encoded;
}

/// Throws unless the fields that say how to decode are those of an encoder.
void check_coding(const schema::CodedCell& wire, const Lattice& lattice) {
  const CellEncoding encoding = encoding_from_wire(wire.encoding());
  const double bound_m = wire.bound_um() * kMetresPerUm;
  const bool is_bound_right = encoding == CellEncoding::kPacked
                                  ? wire.bound_um() == 0
                                  : bound_m >= kMinCompactBoundM && bound_m <= kMaxCompactBoundM;
  if (!is_bound_right) {
    throw Error(ErrorCode::kCorruptData, "the coded CELL has a bound of " +
                                             std::to_string(wire.bound_um()) +
                                             " um; expected 1,000 to 1,000,000, and 0 if packed");
  }
  if (wire.plane_count() > lattice.size() || wire.coarse_plane_count() > wire.plane_count()) {
    throw Error(ErrorCode::kCorruptData, "the coded CELL has " +
                                             std::to_string(wire.plane_count()) + " planes, " +
                                             std::to_string(wire.coarse_plane_count()) +
                                             " of them in its coarse layer, but its lattice has " +
                                             std::to_string(lattice.size()) + " points");
  }
  if (wire.coarse_bytes() > wire.data()->size()) {
    throw Error(ErrorCode::kCorruptData, "the coded CELL has " +
                                             std::to_string(wire.data()->size()) +
                                             " bytes of planes, but a coarse layer of " +
                                             std::to_string(wire.coarse_bytes()));
  }
}

using KeptLattice = std::unique_ptr<CodingLattice>;

CodingLattice& lattice_for(const LatticeSpec& spec, KeptLattice& kept) {
  if (!kept || kept->lattice.spec() != spec) kept = std::make_unique<CodingLattice>(spec);
  return *kept;
}

/// Verified bytes; those after the coarse layer are not looked at where `is_coarse`.
DecodedCell decode_verified(std::span<const std::byte> bytes, bool is_coarse, KeptLattice& kept) {
  const schema::CodedCell& wire = coded_root(bytes);
  DecodedCell decoded;
  decoded.hash = hash_from_wire(*wire.content_hash());
  decoded.raw_hash = hash_from_wire(*wire.raw_hash());
  decoded.encoding = encoding_from_wire(wire.encoding());
  decoded.bound_m = wire.bound_um() * kMetresPerUm;
  decoded.is_coarse = is_coarse;
  decoded.all_planes = wire.plane_count();
  decoded.cell = header_from_wire(wire);
  validate(decoded.cell);  // its planes are as they are decoded
  CodingLattice& lattice = lattice_for(decoded.cell.lattice, kept);
  check_coding(wire, lattice.lattice);
  const std::span data(reinterpret_cast<const std::byte*>(wire.data()->data()),
                       wire.data()->size());
  const LayerView views[] = {
      {data.first(wire.coarse_bytes()), wire.coarse_plane_count()},
      {data.subspan(wire.coarse_bytes()), wire.plane_count() - wire.coarse_plane_count()}};
  const auto layers = std::span(views).first(is_coarse ? 1 : kPlaneLayers);
  const auto version =
      wire.encoding() == schema::Encoding::Compact ? CompactVersion::k1 : CompactVersion::k2;
  DecodedPlanes planes = decoded.encoding == CellEncoding::kPacked
                             ? decode_packed_planes(lattice, layers)
                             : decode_compact_planes(lattice, layers, decoded.bound_m, version);
  decoded.cell.indices = std::move(planes.indices);
  decoded.cell.planes = std::move(planes.planes);
  return decoded;
}

void check_coarse_hash(std::span<const std::byte> prefix, const schema::CodedCell& wire) {
  const ContentHash claimed = hash_from_wire(*wire.coarse_hash());
  const ContentHash actual = hash_without(prefix, *wire.coarse_hash(), *wire.content_hash());
  if (claimed == actual) return;
  throw Error(ErrorCode::kCorruptData, "the coded CELL is damaged: it claims the coarse hash " +
                                           to_hex(claimed) + ", but its bytes have " +
                                           to_hex(actual));
}

std::size_t checked_coarse_bytes(std::span<const std::byte> bytes, const schema::CodedCell& wire) {
  const std::size_t before = bytes_before_data(bytes, wire);
  for (const schema::Hash256* hash : {wire.content_hash(), wire.coarse_hash()}) {
    if (offset_of(bytes, *hash) + sizeof(*hash) > before) {
      throw Error(ErrorCode::kCorruptData, "the data of a coded CELL do not lie after its hashes");
    }
  }
  if (wire.coarse_bytes() <= wire.data()->size()) return before + wire.coarse_bytes();
  throw Error(ErrorCode::kCorruptData, "the coarse layer of a coded CELL is longer than its data");
}

DecodedCell decode_aligned(std::span<const std::byte> bytes, KeptLattice& kept) {
  verify_buffer(bytes, kCodedKind, kMaxCodedTables);
  const schema::CodedCell& wire = coded_root(bytes);
  check_hash(bytes, *wire.content_hash(), kCodedKind.name);
  check_coarse_hash(bytes.first(checked_coarse_bytes(bytes, wire)), wire);
  return decode_verified(bytes, false, kept);
}

CodedLayers coded(const Cell& cell, std::uint32_t bound_um) {
  CodingLattice lattice(cell.lattice);
  return bound_um == 0
             ? encode_packed_planes(lattice, cell.indices, cell.planes)
             : encode_compact_planes(lattice, cell.indices, cell.planes, bound_um * kMetresPerUm);
}

}  // namespace

EncodedCell encode_packed_cell(const Cell& cell) {
  validate(cell);
  return to_file(cell, CellEncoding::kPacked, 0, coded(cell, 0));
}

EncodedCell encode_compact_cell(const Cell& cell, double bound_m) {
  if (!(bound_m >= kMinCompactBoundM && bound_m <= kMaxCompactBoundM)) {
    throw Error(ErrorCode::kInvalidArgument,
                "the bound of a compact CELL must be 0.001 to 1 m, not " + std::to_string(bound_m));
  }
  validate(cell);
  const auto bound_um = static_cast<std::uint32_t>(std::floor(bound_m / kMetresPerUm + 1e-3));
  return to_file(cell, CellEncoding::kCompact, bound_um, coded(cell, bound_um));
}

CellDecoder::CellDecoder() = default;
CellDecoder::~CellDecoder() = default;
CellDecoder::CellDecoder(CellDecoder&&) noexcept = default;
CellDecoder& CellDecoder::operator=(CellDecoder&&) noexcept = default;

DecodedCell CellDecoder::decode(std::span<const std::byte> bytes) {
  check_size(bytes, kCodedKind);
  DecodedCell decoded = is_aligned(bytes)
                            ? decode_aligned(bytes, lattice_)
                            : decode_aligned(Bytes(bytes.begin(), bytes.end()), lattice_);
  if (decoded.encoding == CellEncoding::kPacked &&
      encode_cell(decoded.cell).hash != decoded.raw_hash) {
    throw Error(ErrorCode::kCorruptData,
                "the packed CELL is not the one that it names: unpacked it has another hash than " +
                    to_hex(decoded.raw_hash));
  }
  return decoded;
}

DecodedCell decode_coded_cell(std::span<const std::byte> bytes) {
  return CellDecoder().decode(bytes);
}

DecodedCell decode_coarse_cell(std::span<const std::byte> prefix, std::size_t file_bytes) {
  if (file_bytes < prefix.size() || file_bytes > kMaxCodedCellBytes) {
    throw Error(ErrorCode::kCorruptData, "a coded CELL of " + std::to_string(file_bytes) +
                                             " bytes does not begin with " +
                                             std::to_string(prefix.size()));
  }
  // What is not there reads as zeros, which the structure does not lead to.
  Bytes bytes(prefix.begin(), prefix.end());
  bytes.resize(file_bytes);
  verify_buffer(bytes, kCodedKind, kMaxCodedTables);
  const schema::CodedCell& wire = coded_root(bytes);
  const std::size_t coarse = checked_coarse_bytes(bytes, wire);
  if (coarse > prefix.size()) {
    throw Error(ErrorCode::kCorruptData, "the coarse layer of the coded CELL ends after " +
                                             std::to_string(coarse) + " bytes, but " +
                                             std::to_string(prefix.size()) + " were given");
  }
  check_coarse_hash(std::span(bytes).first(coarse), wire);
  KeptLattice lattice;
  return decode_verified(bytes, true, lattice);
}

std::size_t coarse_cell_bytes(std::span<const std::byte> bytes) {
  const Bytes copy = verified_copy(bytes, kCodedKind, kMaxCodedTables);
  return checked_coarse_bytes(copy, coded_root(copy));
}

ContentHash coded_content_hash(std::span<const std::byte> bytes) {
  const Bytes copy = verified_copy(bytes, kCodedKind, kMaxCodedTables);
  return hash_from_wire(*coded_root(copy).content_hash());
}

}  // namespace cellmap
