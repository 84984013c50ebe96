#include "bench/naive_codec.hpp"

#include <zstd.h>

#include <stdexcept>
#include <vector>

#include "cellmap/schema/cell_generated.h"

namespace cellmap::bench {
namespace {

schema::Pose to_wire(const Pose& T) {
  static_assert(sizeof(schema::Pose) == 12 * sizeof(double));
  double values[12];
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 4; ++col) values[4 * row + col] = T.matrix()(row, col);
  }
  schema::Pose wire;
  std::memcpy(static_cast<void*>(&wire), values, sizeof(wire));
  return wire;
}

Pose from_wire(const schema::Pose* wire) {
  double values[12];
  std::memcpy(values, wire, sizeof(values));
  Pose T = Pose::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int col = 0; col < 4; ++col) T.matrix()(row, col) = values[4 * row + col];
  }
  return T;
}

}  // namespace

std::string naive_encode(const Cell& cell) {
  std::vector<schema::Plane> planes;
  for (const Plane& p : cell.planes) planes.emplace_back(p.distance_m, p.nx, p.ny, p.nz);
  std::vector<std::uint32_t> indices;
  for (const std::uint32_t index : cell.indices) indices.push_back(index);

  flatbuffers::FlatBufferBuilder builder;
  const auto wire_planes = builder.CreateVectorOfStructs(planes);
  const auto wire_indices = builder.CreateVector(indices);
  const auto session = builder.CreateString(cell.session);
  const auto lattice =
      schema::CreateLattice(builder, schema::LatticeKind::Fibonacci, 1, cell.lattice.size);
  const CellStatistics& s = cell.statistics;
  const auto statistics = schema::CreateStatistics(
      builder, s.points, s.points_in_planes, s.patches_hit, s.rejected_few_points, s.rejected_gap,
      s.rejected_planarity, s.rejected_grazing);
  const schema::Hash256 no_hash;
  const schema::Pose pose = to_wire(cell.T_odom_cell);
  schema::FinishCellBuffer(
      builder, schema::CreateCell(builder, 1, &no_hash, lattice, wire_indices, wire_planes, session,
                                  cell.sequence, &pose, cell.first_stamp, cell.last_stamp,
                                  cell.first_scan, cell.scan_count, statistics));
  return {reinterpret_cast<const char*>(builder.GetBufferPointer()), builder.GetSize()};
}

Cell naive_decode(const std::string& bytes) {
  const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data());
  flatbuffers::Verifier verifier(data, bytes.size());
  if (!schema::VerifyCellBuffer(verifier)) throw std::runtime_error("not a CELL");
  const schema::Cell& wire = *schema::GetCell(data);
  Cell cell;
  cell.lattice.size = wire.lattice()->size();
  for (const std::uint32_t index : *wire.indices()) cell.indices.push_back(index);
  for (const schema::Plane* p : *wire.planes()) {
    cell.planes.push_back({p->distance(), p->nx(), p->ny(), p->nz()});
  }
  cell.session = wire.session()->str();
  cell.sequence = wire.sequence();
  cell.T_odom_cell = from_wire(wire.t_odom_cell());
  cell.first_stamp = wire.first_stamp_ns();
  cell.last_stamp = wire.last_stamp_ns();
  cell.first_scan = wire.first_scan();
  cell.scan_count = wire.scan_count();
  return cell;
}

std::string naive_compress(const std::string& bytes) {
  std::string frame(ZSTD_compressBound(bytes.size()), '\0');
  frame.resize(
      ZSTD_compress(frame.data(), frame.size(), bytes.data(), bytes.size(), ZSTD_CLEVEL_DEFAULT));
  return frame;
}

std::string naive_decompress(const std::string& frame) {
  std::string bytes(ZSTD_getFrameContentSize(frame.data(), frame.size()), '\0');
  const std::size_t size = ZSTD_decompress(bytes.data(), bytes.size(), frame.data(), frame.size());
  if (size != bytes.size()) throw std::runtime_error("not a zstd frame");
  return bytes;
}

}  // namespace cellmap::bench
