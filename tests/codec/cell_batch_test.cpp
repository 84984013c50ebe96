#include "cellmap/codec/cell_batch.hpp"

#include <gtest/gtest.h>

#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

std::vector<std::uint32_t> read_ids(const Bytes& batch) {
  CellBatchReader reader(batch);
  std::vector<std::uint32_t> ids;
  while (const auto cell = reader.next()) ids.push_back(cell->id.value);
  return ids;
}

TEST(CellBatch, CellsComeOutAsTheyWentIn) {
  Bytes batch;
  std::vector<EncodedCell> cells;
  for (std::uint32_t i = 0; i < 3; ++i) {
    cells.push_back(encode_cell(random_cell(i, 3 + i)));
    append_to_batch(batch, CellId{0x80000000u + i}, cells.back().bytes);
  }
  CellBatchReader reader(batch);
  for (std::uint32_t i = 0; i < 3; ++i) {
    const auto cell = reader.next();
    ASSERT_TRUE(cell);
    EXPECT_EQ(cell->id.value, 0x80000000u + i);
    EXPECT_EQ(verified_hash(cell->bytes), cells[i].hash);
  }
  EXPECT_FALSE(reader.next());
  EXPECT_FALSE(reader.next());
}

TEST(CellBatch, TheLayoutIsIdLengthBytesInLittleEndian) {
  const Bytes payload = {std::byte{0xAA}, std::byte{0xBB}};
  Bytes batch;
  append_to_batch(batch, CellId{0x01020304}, payload);
  const Bytes expected = {std::byte{4},    std::byte{3},   std::byte{2}, std::byte{1},
                          std::byte{2},    std::byte{0},   std::byte{0}, std::byte{0},
                          std::byte{0xAA}, std::byte{0xBB}};
  EXPECT_EQ(batch, expected);
}

TEST(CellBatch, AnEmptyBatchHasNoCells) { EXPECT_TRUE(read_ids({}).empty()); }

TEST(CellBatch, TruncationInsideAnEntryIsCorruptData) {
  Bytes batch;
  append_to_batch(batch, CellId{1}, Bytes(10));
  const std::size_t first = batch.size();
  append_to_batch(batch, CellId{2}, Bytes(5));
  for (std::size_t length = 0; length < batch.size(); ++length) {
    const Bytes truncated(batch.begin(), batch.begin() + length);
    if (length == 0 || length == first) {
      EXPECT_NO_THROW(read_ids(truncated));
    } else {
      expect_error(
          ErrorCode::kCorruptData, [&] { read_ids(truncated); }, "ends inside");
    }
  }
}

TEST(CellBatch, LimitsHoldBothWays) {
  Bytes batch;
  expect_error(ErrorCode::kTooLarge,
               [&] { append_to_batch(batch, CellId{1}, Bytes(kMaxCellBytes + 1)); });
  EXPECT_TRUE(batch.empty());
  const Bytes huge(8, std::byte{0xff});
  expect_error(ErrorCode::kTooLarge, [&] { read_ids(huge); });
  for (std::size_t i = 0; i < kMaxBatchCells; ++i) append_to_batch(batch, CellId{}, {});
  EXPECT_EQ(read_ids(batch).size(), kMaxBatchCells);
  append_to_batch(batch, CellId{}, {});
  expect_error(ErrorCode::kTooLarge, [&] { read_ids(batch); });
}

}  // namespace
}  // namespace cellmap
