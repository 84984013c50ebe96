#include "cellmap/codec/drive_part_codec.hpp"

#include <gtest/gtest.h>

#include <random>

#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

MadeCell random_made_cell(std::uint32_t seed) {
  std::mt19937 rng(seed);
  MadeCell made;
  made.cell = std::make_shared<const Cell>(random_cell(seed, 200, 5'000));
  for (std::uint32_t i = 0; i < made.cell->scan_count; ++i) {
    made.scans.push_back(
        {made.cell->first_stamp + i, i == 0 ? Pose::Identity() : random_pose(rng)});
  }
  made.raw_points = 5'000'000'000 + seed;
  std::uint64_t key = 0;
  for (int i = 0; i < 300; ++i) made.voxels.push_back({key += 1 + rng() % 1000, rng() | 1});
  made.voxels.push_back({kVoxelKeys - 1, ~std::uint64_t{0}});
  return made;
}

void expect_equal(const MadeCell& a, const MadeCell& b) {
  EXPECT_EQ(encode_cell(*a.cell).bytes, encode_cell(*b.cell).bytes);
  ASSERT_EQ(a.scans.size(), b.scans.size());
  for (std::size_t i = 0; i < a.scans.size(); ++i) {
    EXPECT_EQ(a.scans[i].stamp, b.scans[i].stamp);
    EXPECT_EQ(a.scans[i].T_cell_scan.matrix(), b.scans[i].T_cell_scan.matrix());
  }
  EXPECT_EQ(a.raw_points, b.raw_points);
  EXPECT_EQ(a.voxels, b.voxels);
}

Bytes encoded(const MadeCell& made) { return encode_drive_part(std::span(&made, 1)); }

TEST(DrivePartCodec, CellsSurviveTheRoundTripExactly) {
  std::vector<MadeCell> cells;
  for (std::uint32_t seed = 1; seed <= 5; ++seed) cells.push_back(random_made_cell(seed));
  cells[2].voxels.clear();
  const auto decoded = decode_drive_part(encode_drive_part(cells));
  ASSERT_EQ(decoded.size(), cells.size());
  for (std::size_t i = 0; i < cells.size(); ++i) expect_equal(decoded[i], cells[i]);
  EXPECT_TRUE(decode_drive_part(encode_drive_part({})).empty());
}

TEST(DrivePartCodec, ScansVoxelsAndCellsThatCannotBeAreRefused) {
  const auto expect_refused = [](const auto& spoil, const std::string& why) {
    MadeCell made = random_made_cell(7);
    spoil(made);
    const Bytes bytes = encoded(made);
    expect_error(
        ErrorCode::kCorruptData, [&] { decode_drive_part(bytes); }, why);
  };
  expect_refused([](MadeCell& made) { made.scans.pop_back(); }, "7 scans has 6");
  expect_refused([](MadeCell& made) { made.scans.clear(); }, "found 0");
  expect_refused([](MadeCell& made) { made.scans[1].T_cell_scan(0, 0) = 3; }, "rigid");
  expect_refused([](MadeCell& made) { std::swap(made.voxels[3], made.voxels[4]); }, "keys");
  expect_refused([](MadeCell& made) { made.voxels[4].key = made.voxels[3].key; }, "keys");
  expect_refused([](MadeCell& made) { made.voxels.back().key = kVoxelKeys; }, "keys");
  expect_refused([](MadeCell& made) { made.voxels.back().key = ~std::uint64_t{0}; }, "keys");
}

TEST(DrivePartCodec, LimitsHold) {
  const std::vector<MadeCell> many(kMaxDrivePartCells + 1, random_made_cell(1));
  expect_error(
      ErrorCode::kTooLarge, [&] { encode_drive_part(many); }, "at most 64 CELLs");
  MadeCell large = random_made_cell(1);
  large.voxels.clear();
  for (std::uint64_t key = 0; key < kMaxDrivePartBytes / 16; ++key)
    large.voxels.push_back({key, 1});
  expect_error(ErrorCode::kTooLarge, [&] { encoded(large); });
  expect_error(ErrorCode::kTooLarge, [] { decode_drive_part(Bytes(kMaxDrivePartBytes + 1)); });
}

TEST(DrivePartCodec, EveryTruncationAndEveryFlippedByteIsRefusedOrAPart) {
  const Bytes good = encoded(random_made_cell(3));
  for (std::size_t size = 0; size < good.size(); size += 1 + size / 50) {
    const Bytes cut(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size));
    expect_error(ErrorCode::kCorruptData, [&] { decode_drive_part(cut); });
  }
  std::mt19937 rng(4);
  int refused = 0;
  for (int i = 0; i < 2'000; ++i) {
    Bytes bytes = good;
    const std::size_t range = i % 2 ? bytes.size() : 400;
    bytes[rng() % range] ^= static_cast<std::byte>(1 + rng() % 255);
    const auto thrown = thrown_by([&] { encode_drive_part(decode_drive_part(bytes)); });
    refused += thrown.has_value();
    if (thrown) {
      EXPECT_TRUE(thrown->code == ErrorCode::kCorruptData ||
                  thrown->code == ErrorCode::kUnsupported || thrown->code == ErrorCode::kTooLarge)
          << thrown->message;
    }
  }
  EXPECT_GT(refused, 500) << "the CELL, half of the bytes, has its hash";
}

}  // namespace
}  // namespace cellmap
