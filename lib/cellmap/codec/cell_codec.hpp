#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/core/hash.hpp"

namespace cellmap {

using Bytes = std::vector<std::byte>;

/// A CELL as it is stored and sent: a FlatBuffers buffer (schema/cell.fbs, identifier "CELL"),
/// specified to the byte in schema/FORMAT.md.
struct EncodedCell {
  ContentHash hash;  ///< SHA-256 of `bytes` with the 32 bytes of the hash field set to zero
  Bytes bytes;
};

/// Deterministic: equal CELLs give equal bytes on every machine, and decoding and encoding again
/// gives the same bytes, so that a CELL keeps its hash. Bytes that came from elsewhere may be laid
/// out differently: pass them on as {verified_hash(bytes), bytes}. About 0.2 ms for 5,800 planes.
/// Throws Error{kCorruptData} where `validate` does, {kUnsupported} for an unknown lattice.
EncodedCell encode_cell(const Cell& cell);

/// A CELL read where its bytes lie; nothing of its size is copied. Valid as long as the bytes are.
struct CellView {
  ContentHash hash;
  Cell header;                             ///< everything but indices and planes, which are empty
  std::span<const std::uint32_t> indices;  ///< into the bytes
  std::span<const Plane> planes;           ///< into the bytes

  Cell to_cell() const;  ///< a CELL of its own
};

/// Trusts no byte, as `decode_cell`, and throws the same. `bytes` begin at a multiple of 8, as
/// those of every `Bytes` do (else Error{kInvalidArgument}: copy them first). For 5,800 planes
/// about 0.12 ms, half of it for the rules of `validate` and half for the hash; 2 ms more for a
/// lattice of bands, whose directions are counted first.
CellView view_cell(std::span<const std::byte> bytes);

/// Trusts no byte: alignment, FlatBuffers verifier (bounded depth and tables), schema version,
/// content hash, then `validate(cell)`. Throws Error{kCorruptData}, or {kUnsupported} for a newer
/// version or an unknown lattice, or {kTooLarge} over `kMaxCellBytes`.
Cell decode_cell(std::span<const std::byte> bytes);

/// The CELL of a zstd frame that a store gave out. The store has compared the frame with the
/// checksum that it wrote beside it (Store::compressed_cell), so the content hash is not computed
/// once more; everything else is verified as by `decode_cell`, which throws the same.
Cell decode_stored_cell(std::span<const std::byte> frame);

/// The hash that the bytes claim, checked against them. Cheaper than decoding.
ContentHash verified_hash(std::span<const std::byte> bytes);

/// Limit of an encoded CELL: a full lattice of a million points.
constexpr std::size_t kMaxCellBytes = 24u << 20;

}  // namespace cellmap
