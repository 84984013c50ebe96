#include "cellmap/codec/scan_codec.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <limits>

#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

constexpr int kScanPose = 3, kX = 4, kY = 5;

void expect_same_bits(const std::vector<float>& a, const std::vector<float>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(std::bit_cast<std::uint32_t>(a[i]), std::bit_cast<std::uint32_t>(b[i]));
  }
}

void expect_equal(const PosedScan& a, const PosedScan& b) {
  EXPECT_EQ(a.index, b.index);
  EXPECT_EQ(a.stamp, b.stamp);
  EXPECT_EQ(a.T_odom_sensor.matrix(), b.T_odom_sensor.matrix());
  expect_same_bits(a.points.x, b.points.x);
  expect_same_bits(a.points.y, b.points.y);
  expect_same_bits(a.points.z, b.points.z);
}

TEST(ScanCodec, AScanSurvivesTheRoundTripExactly) {
  for (const std::size_t points : {0, 1, 2, 3, 1000}) {
    const PosedScan scan = random_scan(1, points);
    expect_equal(decode_scan(encode_scan(scan)), scan);
  }
}

TEST(ScanCodec, RawSweepsKeepTheirNanAndInfinity) {
  PosedScan scan = random_scan(2, 5);
  scan.points.x[1] = std::numeric_limits<float>::quiet_NaN();
  scan.points.y[2] = -std::numeric_limits<float>::infinity();
  scan.points.z[3] = std::numeric_limits<float>::signaling_NaN();
  scan.points.z[4] = -0.0f;
  expect_equal(decode_scan(encode_scan(scan)), scan);
}

TEST(ScanCodec, EncodingIsDeterministic) {
  EXPECT_EQ(encode_scan(random_scan(3, 100)), encode_scan(random_scan(3, 100)));
}

TEST(ScanCodec, UnequalLengthsAreNamed) {
  Bytes bytes = encode_scan(random_scan(4, 10));
  RawBuffer raw(bytes);
  raw.set<std::uint32_t>(raw.target(raw.root(), kY), 9);
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_scan(bytes); }, "10, 9 and 10");
}

TEST(ScanCodec, APoseThatIsNotRigidIsRefusedBothWays) {
  PosedScan scan = random_scan(5, 10);
  Bytes bytes = encode_scan(scan);
  RawBuffer raw(bytes);
  raw.set(raw.field(raw.root(), kScanPose), std::numeric_limits<double>::quiet_NaN());
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_scan(bytes); }, "T_odom_sensor");
  scan.T_odom_sensor.linear() *= 2;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { encode_scan(scan); }, "T_odom_sensor");
}

TEST(ScanCodec, TooManyPointsAreRefused) {
  PosedScan scan;
  scan.points.x.resize(kMaxScanPoints);
  scan.points.y.resize(kMaxScanPoints);
  scan.points.z.resize(kMaxScanPoints);
  EXPECT_EQ(decode_scan(encode_scan(scan)).points.size(), kMaxScanPoints);
  scan.points.push_back({0, 0, 0});
  expect_error(
      ErrorCode::kTooLarge, [&] { encode_scan(scan); }, "2000001");
}

TEST(ScanCodec, AVectorThatIsClaimedLongerThanTheBufferIsCorruptData) {
  Bytes bytes = encode_scan(random_scan(6, 10));
  RawBuffer raw(bytes);
  for (const std::uint32_t length : {2000u, 0x40000000u, 0xffffffffu}) {
    raw.set<std::uint32_t>(raw.target(raw.root(), kX), length);
    expect_error(ErrorCode::kCorruptData, [&] { decode_scan(bytes); });
  }
}

TEST(ScanCodec, TruncationAtAnyLengthIsCorruptData) {
  const Bytes bytes = encode_scan(random_scan(7, 10));
  std::size_t refused = 0;
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    const Bytes truncated(bytes.begin(), bytes.begin() + length);
    const auto thrown = thrown_by([&] { decode_scan(truncated); });
    if (!thrown) continue;  // only padding at the end may go
    EXPECT_EQ(to_string(thrown->code), "corrupt-data");
    ++refused;
  }
  EXPECT_GE(refused, bytes.size() - 8);
}

TEST(ScanCodec, AFlippedByteNeverCrashes) {
  const Bytes good = encode_scan(random_scan(8, 4));
  for (std::size_t at = 0; at < good.size(); ++at) {
    for (int bit = 0; bit < 8; ++bit) {
      Bytes bytes = good;
      bytes[at] ^= std::byte{1} << bit;
      std::optional<PosedScan> scan;
      thrown_by([&] { scan = decode_scan(bytes); });
      if (scan) {
        EXPECT_EQ(scan->points.x.size(), scan->points.z.size());
      }
    }
  }
}

TEST(ScanCodec, MisalignedInputIsReadAsWell) {
  const PosedScan scan = random_scan(9, 10);
  const Bytes bytes = encode_scan(scan);
  Bytes shifted(3);
  shifted.insert(shifted.end(), bytes.begin(), bytes.end());
  expect_equal(decode_scan(std::span(shifted).subspan(3)), scan);
}

TEST(ScanCodec, ACellIsNoScan) {
  const Bytes cell = encode_cell(random_cell(1, 3)).bytes;
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_scan(cell); }, "'CSCN', found 'CELL'");
}

}  // namespace
}  // namespace cellmap
