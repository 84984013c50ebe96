#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {

/// How a coded CELL keeps its planes.
enum class CellEncoding : std::uint8_t {
  kPacked = 1,   ///< every bit
  kCompact = 2,  ///< within a bound
};

constexpr double kDefaultCompactBoundM = 0.02;
constexpr double kMinCompactBoundM = 0.001, kMaxCompactBoundM = 1.0;

/// The CELL without loss, in little more than half the bytes. `bytes` are a coded CELL
/// (schema/coded_cell.fbs, identifier "CCOD", FORMAT.md), `hash` its content hash. Deterministic,
/// as `encode_cell`, and throws the same. About 2 ms for 5,800 planes.
EncodedCell encode_packed_cell(const Cell& cell);

/// The CELL with a guarantee: no point of a plane within its patch (the disc of
/// Lattice::patch_radius_rad) moves by more than `bound_m` along the plane's normal, as
/// `plane_displacement_m` measures it. Everything else is kept exactly. The bound is kept in whole
/// micrometres, rounded down. Deterministic; throws what `encode_cell` throws, and
/// Error{kInvalidArgument} for a bound outside 1 mm to 1 m. About 5 ms for 5,800 planes.
EncodedCell encode_compact_cell(const Cell& cell, double bound_m = kDefaultCompactBoundM);

/// What a coded CELL holds.
struct DecodedCell {
  ContentHash hash;      ///< of the coded bytes
  ContentHash raw_hash;  ///< of the CELL that was coded, as `encode_cell` has it
  CellEncoding encoding = CellEncoding::kPacked;
  double bound_m = 0;          ///< 0 where every bit was kept
  bool is_coarse = false;      ///< only the planes of the coarse layer are there
  std::size_t all_planes = 0;  ///< of the CELL, `cell.planes.size()` unless it is coarse
  Cell cell;
};

/// Trusts no byte, as `decode_cell`, and throws the same: any bytes give a CELL for which
/// `validate` holds, or an Error. A packed CELL is encoded again and must have its raw hash. Time
/// and memory are bounded by the lattice that the bytes name. About 1 ms for 5,800 planes.
DecodedCell decode_coded_cell(std::span<const std::byte> bytes);

struct CodingLattice;

/// Decodes CELL after CELL, each as `decode_coded_cell` does, and keeps what it knows of their
/// lattice from one to the next: a twentieth of the time for 5,800 planes. For one thread at a
/// time; after an Error it is as good as before.
class CellDecoder {
 public:
  CellDecoder();
  ~CellDecoder();
  CellDecoder(CellDecoder&&) noexcept;
  CellDecoder& operator=(CellDecoder&&) noexcept;

  DecodedCell decode(std::span<const std::byte> bytes);

 private:
  std::unique_ptr<CodingLattice> lattice_;  // of the CELL decoded last
};

/// The planes of the coarse layer alone, about a quarter, as a CELL of their own: those whose point
/// of their sphere is a multiple of four. `prefix` are the first `coarse_cell_bytes` bytes, or
/// more, of a coded CELL of `file_bytes` bytes. They are held to a hash of their own. Throws as
/// `decode_coded_cell`.
DecodedCell decode_coarse_cell(std::span<const std::byte> prefix, std::size_t file_bytes);

/// How many bytes of a coded CELL a coarse reader needs. Checks the structure, not the hashes;
/// throws as `decode_coded_cell`.
std::size_t coarse_cell_bytes(std::span<const std::byte> bytes);

/// The content hash that a coded CELL claims; structure checked, bytes not. Throws as
/// `decode_coded_cell`.
ContentHash coded_content_hash(std::span<const std::byte> bytes);

/// Limit of a coded CELL.
constexpr std::size_t kMaxCodedCellBytes = 24u << 20;

}  // namespace cellmap
