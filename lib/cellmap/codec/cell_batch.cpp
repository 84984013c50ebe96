#include "cellmap/codec/cell_batch.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kHeaderBytes = 8;

void append_u32(Bytes& bytes, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) {
    bytes.push_back(static_cast<std::byte>(value >> shift));
  }
}

std::uint32_t read_u32(std::span<const std::byte> bytes) {
  std::uint32_t value = 0;
  for (int i = 3; i >= 0; --i) value = value << 8 | std::to_integer<std::uint32_t>(bytes[i]);
  return value;
}

void check_size(const char* what, std::size_t size, std::size_t limit) {
  if (size > limit) {
    throw Error(ErrorCode::kTooLarge, std::string(what) + " is at most " + std::to_string(limit) +
                                          ", but " + std::to_string(size) + " was found");
  }
}

}  // namespace

void append_to_batch(Bytes& batch, CellId id, std::span<const std::byte> cell) {
  check_size("the length of a CELL in a batch", cell.size(), kMaxCellBytes);
  check_size("the length of a batch of CELLs", batch.size() + kHeaderBytes + cell.size(),
             kMaxBatchBytes);
  append_u32(batch, id.value);
  append_u32(batch, static_cast<std::uint32_t>(cell.size()));
  batch.insert(batch.end(), cell.begin(), cell.end());
}

CellBatchReader::CellBatchReader(std::span<const std::byte> batch) : rest_(batch) {
  check_size("the length of a batch of CELLs", batch.size(), kMaxBatchBytes);
}

std::optional<BatchedCell> CellBatchReader::next() {
  if (rest_.empty()) return std::nullopt;
  const auto truncated = [this](const char* where, std::size_t expected) {
    return Error(ErrorCode::kCorruptData,
                 "the batch of CELLs ends inside the " + std::string(where) + " of its entry " +
                     std::to_string(cells_) + ": expected " + std::to_string(expected) +
                     " bytes, found " + std::to_string(rest_.size()));
  };
  if (rest_.size() < kHeaderBytes) throw truncated("header", kHeaderBytes);
  const CellId id{read_u32(rest_)};
  const std::size_t length = read_u32(rest_.subspan(4));
  rest_ = rest_.subspan(kHeaderBytes);
  check_size("the length of a CELL in a batch", length, kMaxCellBytes);
  if (rest_.size() < length) throw truncated("CELL", length);
  check_size("the number of CELLs in a batch", ++cells_, kMaxBatchCells);
  const BatchedCell cell{id, rest_.first(length)};
  rest_ = rest_.subspan(length);
  return cell;
}

}  // namespace cellmap
