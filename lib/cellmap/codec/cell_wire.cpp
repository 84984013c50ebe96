#include "cellmap/codec/cell_wire.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::uint8_t kLatticeVersion = 1;  // of every kind

/// SHA-256 of the bytes with zeros in place of the hash at `offset`.
ContentHash hash_of(std::span<const std::byte> bytes, std::size_t offset) {
  constexpr std::array<std::byte, sizeof(ContentHash)> kZeros{};
  return sha256_of_pieces({bytes.first(offset), kZeros, bytes.subspan(offset + kZeros.size())});
}

static_assert(int(schema::LatticeKind::Fibonacci) == int(LatticeKind::kFibonacci) &&
                  int(schema::LatticeKind::FibonacciBands) == int(LatticeKind::kFibonacciBands),
              "both are the format's numbers");

}  // namespace

std::size_t offset_of(std::span<const std::byte> bytes, const schema::Hash256& hash) {
  return static_cast<std::size_t>(reinterpret_cast<const std::byte*>(&hash) - bytes.data());
}

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

flatbuffers::Offset<schema::Lattice> lattice_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                                     const LatticeSpec& spec) {
  return schema::CreateLattice(builder, static_cast<schema::LatticeKind>(spec.kind),
                               kLatticeVersion, spec.size);
}

flatbuffers::Offset<schema::Statistics> statistics_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                                           const CellStatistics& s) {
  return schema::CreateStatistics(builder, s.points, s.points_in_planes, s.patches_hit,
                                  s.rejected_few_points, s.rejected_gap, s.rejected_planarity,
                                  s.rejected_grazing);
}

ContentHash hash_from_wire(const schema::Hash256& wire) {
  ContentHash hash;
  std::memcpy(hash.bytes.data(), static_cast<const void*>(&wire), sizeof(hash));
  return hash;
}

schema::Hash256 hash_to_wire(const ContentHash& hash) {
  schema::Hash256 wire;
  std::memcpy(static_cast<void*>(&wire), hash.bytes.data(), sizeof(wire));
  return wire;
}

ContentHash check_hash(std::span<const std::byte> bytes, const schema::Hash256& claimed_hash,
                       const char* kind) {
  const ContentHash claimed = hash_from_wire(claimed_hash);
  const ContentHash actual = hash_of(bytes, offset_of(bytes, claimed_hash));
  if (claimed != actual) {
    throw Error(ErrorCode::kCorruptData,
                std::string("the ") + kind + " is damaged: it claims the content hash " +
                    to_hex(claimed) + ", but its bytes have " + to_hex(actual));
  }
  return actual;
}

ContentHash write_hash(std::span<std::byte> bytes, const schema::Hash256& place) {
  const std::size_t offset = offset_of(bytes, place);
  const ContentHash hash = hash_of(bytes, offset);
  std::memcpy(bytes.data() + offset, hash.bytes.data(), sizeof(hash));
  return hash;
}

ContentHash hash_without(std::span<const std::byte> bytes, const schema::Hash256& first,
                         const schema::Hash256& second) {
  constexpr std::array<std::byte, sizeof(ContentHash)> kZeros{};
  const std::size_t a = std::min(offset_of(bytes, first), offset_of(bytes, second));
  const std::size_t b = std::max(offset_of(bytes, first), offset_of(bytes, second));
  if (b - a < kZeros.size()) {
    throw Error(ErrorCode::kCorruptData, "two hashes of a coded CELL overlap");
  }
  return sha256_of_pieces({bytes.first(a), kZeros,
                           bytes.subspan(a + kZeros.size(), b - a - kZeros.size()), kZeros,
                           bytes.subspan(b + kZeros.size())});
}

void write_hash_without(std::span<std::byte> bytes, const schema::Hash256& place,
                        const schema::Hash256& other) {
  const ContentHash hash = hash_without(bytes, place, other);
  std::memcpy(bytes.data() + offset_of(bytes, place), hash.bytes.data(), sizeof(hash));
}

}  // namespace cellmap
