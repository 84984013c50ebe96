#include "cellmap/codec/scan_batch.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

PosedScan scan_of(std::size_t index, std::size_t points = 3) {
  PosedScan scan;
  scan.index = index;
  scan.stamp = static_cast<Stamp>(index) * 7;
  scan.T_odom_sensor.translation().x() = static_cast<double>(index);
  for (std::size_t i = 0; i < points; ++i) scan.points.push_back({1, static_cast<float>(i), 3});
  return scan;
}

Bytes batch_of(const std::vector<std::size_t>& indices) {
  Bytes batch;
  for (const std::size_t index : indices) append_to_scan_batch(batch, scan_of(index));
  return batch;
}

TEST(ScanBatch, ScansComeOutAsTheyWentIn) {
  const auto scans = decode_scan_batch(batch_of({5, 6, 7}));
  ASSERT_EQ(scans.size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const PosedScan expected = scan_of(5 + i);
    EXPECT_EQ(scans[i].index, expected.index);
    EXPECT_EQ(scans[i].stamp, expected.stamp);
    EXPECT_EQ(scans[i].points.y, expected.points.y);
    EXPECT_TRUE(scans[i].T_odom_sensor.isApprox(expected.T_odom_sensor, 0));
  }
}

TEST(ScanBatch, TheLayoutIsLengthAndBytesInLittleEndian) {
  const PosedScan scan = scan_of(4, 300);
  const Bytes bytes = encode_scan(scan);
  Bytes expected = {static_cast<std::byte>(bytes.size() & 0xff),
                    static_cast<std::byte>(bytes.size() >> 8), std::byte{0}, std::byte{0}};
  expected.insert(expected.end(), bytes.begin(), bytes.end());
  Bytes batch;
  append_to_scan_batch(batch, scan);
  EXPECT_EQ(batch, expected);
}

TEST(ScanBatch, TruncationAnywhereButBetweenScansIsCorruptData) {
  const Bytes batch = batch_of({0, 1});
  const std::size_t first = batch_of({0}).size();
  for (std::size_t length = 0; length < batch.size(); ++length) {
    const std::span<const std::byte> truncated(batch.data(), length);
    if (length == first) {
      EXPECT_EQ(decode_scan_batch(truncated).size(), 1u);
    } else {
      expect_error(ErrorCode::kCorruptData, [&] { decode_scan_batch(truncated); });
    }
  }
}

TEST(ScanBatch, ScansFollowOneAnother) {
  for (const auto& indices : std::vector<std::vector<std::size_t>>{{0, 0}, {0, 2}, {1, 0}}) {
    expect_error(
        ErrorCode::kCorruptData, [&] { decode_scan_batch(batch_of(indices)); },
        "follow one another");
  }
}

TEST(ScanBatch, MoreScansOrBytesThanTheLimitAreRefused) {
  std::vector<std::size_t> indices(kMaxBatchScans);
  for (std::size_t i = 0; i < indices.size(); ++i) indices[i] = i;
  EXPECT_EQ(decode_scan_batch(batch_of(indices)).size(), kMaxBatchScans);
  indices.push_back(kMaxBatchScans);
  expect_error(ErrorCode::kTooLarge, [&] { decode_scan_batch(batch_of(indices)); });
  expect_error(ErrorCode::kTooLarge, [&] { decode_scan_batch(Bytes(kMaxScanBatchBytes + 1)); });
  Bytes full(kMaxScanBatchBytes - 100);
  expect_error(ErrorCode::kTooLarge, [&] { append_to_scan_batch(full, scan_of(0)); });
}

}  // namespace
}  // namespace cellmap
