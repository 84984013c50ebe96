#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/id.hpp"

namespace cellmap {

/// Limits of a batch (application/vnd.cellmap.cells; FORMAT.md, "Batch of CELLs").
constexpr std::size_t kMaxBatchCells = 10'000;
constexpr std::size_t kMaxBatchBytes = 512u << 20;

/// Appends one encoded CELL to a batch: id and length as little-endian uint32, then the bytes.
/// Throws Error{kTooLarge} where the CELL or the batch would be over its limit.
void append_to_batch(Bytes& batch, CellId id, std::span<const std::byte> cell);

/// One CELL of a batch; `bytes` points into the batch and is not verified (`decode_cell` does
/// that).
struct BatchedCell {
  CellId id;
  std::span<const std::byte> bytes;
};

/// Reads a batch CELL by CELL without copying. The batch must outlive the reader. Untrusted input:
/// nothing is allocated and nothing is read outside it. Not thread safe.
class CellBatchReader {
 public:
  /// Throws Error{kTooLarge} over `kMaxBatchBytes`.
  explicit CellBatchReader(std::span<const std::byte> batch);

  /// The next CELL, or nullopt at the end. Throws Error{kCorruptData} where the batch ends inside
  /// an entry, {kTooLarge} where an entry is over `kMaxCellBytes` or there are over
  /// `kMaxBatchCells`.
  std::optional<BatchedCell> next();

 private:
  std::span<const std::byte> rest_;
  std::size_t cells_ = 0;
};

}  // namespace cellmap
