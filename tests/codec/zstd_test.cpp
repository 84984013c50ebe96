#include "cellmap/codec/zstd.hpp"

#include <gtest/gtest.h>

#include <array>
#include <random>

#include "codec/raw_buffer.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

Bytes random_bytes(std::size_t size, unsigned alphabet) {
  std::mt19937 rng(static_cast<unsigned>(size));
  Bytes bytes(size);
  for (std::byte& b : bytes) b = std::byte(rng() % alphabet);
  return bytes;
}

Bytes from_octets(std::initializer_list<int> octets) {
  Bytes bytes;
  for (const int octet : octets) bytes.push_back(std::byte(octet));
  return bytes;
}

TEST(Zstd, DataSurviveTheRoundTrip) {
  for (const std::size_t size : {0, 1, 100, 100'000}) {
    for (const int level : {1, 3, 19}) {
      const Bytes data = random_bytes(size, 7);
      EXPECT_EQ(zstd_decompress(zstd_compress(data, level), size), data);
    }
  }
}

TEST(Zstd, RepetitiveDataShrink) {
  const Bytes data(100'000, std::byte{'a'});
  EXPECT_LT(zstd_compress(data).size(), 100u);
}

TEST(Zstd, TheLimitIsExact) {
  const Bytes frame = zstd_compress(random_bytes(1000, 256));
  EXPECT_EQ(zstd_decompress(frame, 1000).size(), 1000u);
  expect_error(
      ErrorCode::kTooLarge, [&] { zstd_decompress(frame, 999); }, "1000");
}

TEST(Zstd, ABombIsRefusedByItsHeader) {
  // RFC 8878: magic, descriptor 0xE0 (8-byte size, single segment), size 2^40, an RLE block.
  const Bytes bomb =
      from_octets({0x28, 0xB5, 0x2F, 0xFD, 0xE0, 0, 0, 0, 0, 0, 1, 0, 0, 0x03, 0, 0, 0});
  expect_error(
      ErrorCode::kTooLarge, [&] { zstd_decompress(bomb, 24u << 20); }, "1099511627776");
}

TEST(Zstd, ADeclaredSizeThatTheBlocksDoNotFillIsCorruptData) {
  // Descriptor 0x20 (1-byte size, single segment), a last raw block of 3 bytes.
  const auto frame = [](int declared) {
    return from_octets({0x28, 0xB5, 0x2F, 0xFD, 0x20, declared, 0x19, 0, 0, 'a', 'b', 'c'});
  };
  EXPECT_EQ(zstd_decompress(frame(3), 100), from_octets({'a', 'b', 'c'}));
  expect_error(ErrorCode::kCorruptData, [&] { zstd_decompress(frame(4), 100); });
  expect_error(ErrorCode::kCorruptData, [&] { zstd_decompress(frame(2), 100); });
}

TEST(Zstd, AFrameWithoutDeclaredSizeIsCorruptData) {
  // Descriptor 0x00: no size, window descriptor 0; a last raw block of 3 bytes.
  const Bytes frame = from_octets({0x28, 0xB5, 0x2F, 0xFD, 0x00, 0x00, 0x19, 0, 0, 'a', 'b', 'c'});
  expect_error(
      ErrorCode::kCorruptData, [&] { zstd_decompress(frame, 100); }, "does not declare");
}

TEST(Zstd, OneFrameAndNothingElse) {
  const Bytes data = random_bytes(100, 5);
  const Bytes frame = zstd_compress(data);
  Bytes trailing = frame, twice = frame;
  trailing.push_back(std::byte{0});
  twice.insert(twice.end(), frame.begin(), frame.end());
  expect_error(
      ErrorCode::kCorruptData, [&] { zstd_decompress(trailing, 1000); }, "ends after");
  expect_error(
      ErrorCode::kCorruptData, [&] { zstd_decompress(twice, 1000); }, "ends after");
  const Bytes skippable = from_octets({0x50, 0x2A, 0x4D, 0x18, 0, 0, 0, 0});
  expect_error(
      ErrorCode::kCorruptData, [&] { zstd_decompress(skippable, 1000); }, "magic");
  expect_error(
      ErrorCode::kCorruptData, [&] { zstd_decompress({}, 1000); }, "magic");
}

TEST(Zstd, TruncationAndFlippedBitsAreDetected) {
  const Bytes data = random_bytes(300, 3);
  const Bytes frame = zstd_compress(data);
  for (std::size_t at = 0; at < frame.size(); ++at) {
    const Bytes truncated(frame.begin(), frame.begin() + at);
    expect_error(ErrorCode::kCorruptData, [&] { zstd_decompress(truncated, 1000); });
    for (int bit = 0; bit < 8; ++bit) {
      Bytes flipped = frame;
      flipped[at] ^= std::byte{1} << bit;
      const auto thrown = thrown_by([&] {
        // A bit of the header may ask for a larger window and change nothing else.
        EXPECT_EQ(zstd_decompress(flipped, 1000), data);
      });
      if (thrown) {
        EXPECT_TRUE(thrown->code == ErrorCode::kCorruptData ||
                    thrown->code == ErrorCode::kTooLarge);
      }
    }
  }
}

TEST(Zstd, AnImpossibleLevelIsRefused) {
  expect_error(ErrorCode::kInvalidArgument, [] { zstd_compress({}, 0); });
  expect_error(ErrorCode::kInvalidArgument, [] { zstd_compress({}, 99); });
}

}  // namespace
}  // namespace cellmap
