#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "cellmap/scan/scan_source.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using test::expect_error;

std::string bytes_of(const std::vector<float>& values) {
  std::string bytes(values.size() * sizeof(float), '\0');
  std::memcpy(bytes.data(), values.data(), bytes.size());
  return bytes;
}

TEST(KittiBin, HoldsXYZAndAnIntensityThatIsIgnored) {
  const test::TempFolder folder;
  const auto file = folder.write("0.bin", bytes_of({1, 2, 3, 99, -4, 5.5F, 1e-3F, 0}));
  const PointCloud points = read_kitti_bin(file);
  ASSERT_EQ(points.size(), 2U);
  EXPECT_EQ(points[0], Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(points[1], Eigen::Vector3f(-4, 5.5F, 1e-3F));
}

TEST(KittiBin, OneIsLittleEndian) {
  const test::TempFolder folder;
  const auto file = folder.write("0.bin", std::string("\0\0\x80\x3f\0\0\0\0\0\0\0\0\0\0\0\0", 16));
  EXPECT_EQ(read_kitti_bin(file)[0], Eigen::Vector3f(1, 0, 0));
}

TEST(KittiBin, WhatIsWrittenReadsBackTheSameWithNan) {
  const test::TempFolder folder;
  PointCloud points;
  points.push_back({1, 2, 3});
  points.push_back({std::numeric_limits<float>::quiet_NaN(), -0.0F, 1e30F});
  write_kitti_bin(folder / "0.bin", points);
  const PointCloud read = read_kitti_bin(folder / "0.bin");
  ASSERT_EQ(read.size(), 2U);
  EXPECT_EQ(read[0], points[0]);
  EXPECT_TRUE(std::isnan(read.x[1]));
  EXPECT_EQ(read.z[1], 1e30F);
  EXPECT_EQ(file_size(folder / "0.bin"), 32U);
}

TEST(KittiBin, ACutOffFileIsRefusedAtEveryLengthThatIsNotWhole) {
  const test::TempFolder folder;
  const std::string whole = bytes_of({1, 2, 3, 4, 5, 6, 7, 8});
  for (std::size_t length = 1; length < whole.size(); ++length) {
    const auto file = folder.write("cut.bin", whole.substr(0, length));
    if (length == 16) {
      EXPECT_EQ(read_kitti_bin(file).size(), 1U);
    } else {
      expect_error(
          ErrorCode::kCorruptData, [&] { read_kitti_bin(file); }, "cut.bin",
          "found " + std::to_string(length));
    }
  }
}

TEST(KittiBin, AnEmptyFileIsAnErrorButNoBytesAreNoPoints) {
  const test::TempFolder folder;
  const auto file = folder.write("0.bin", "");
  expect_error(
      ErrorCode::kCorruptData, [&] { read_kitti_bin(file); }, "0.bin", "empty");
  EXPECT_TRUE(parse_kitti_bin({}).empty());
}

TEST(KittiBin, MorePointsThanTheLimitAreRefused) {
  const std::vector<std::byte> bytes(11 * 16);
  EXPECT_EQ(parse_kitti_bin(bytes, 11).size(), 11U);
  expect_error(
      ErrorCode::kTooLarge, [&] { parse_kitti_bin(bytes, 10); }, "at most 10", "found 11");
}

TEST(KittiBin, AHugeFileIsRefusedByItsSizeBeforeItIsRead) {
  const test::TempFolder folder;
  const auto file = folder.write("huge.bin", "x");
  resize_file(file, std::uintmax_t{1} << 40);  // sparse: takes no space
  expect_error(
      ErrorCode::kTooLarge, [&] { read_kitti_bin(file); }, "huge.bin");
}

TEST(KittiBin, AMissingFileIsNotFound) {
  expect_error(
      ErrorCode::kNotFound, [] { read_kitti_bin("/nowhere/0.bin"); }, "/nowhere/0.bin");
}

TEST(KittiBin, NoPointsOrTooManyAreNotWritten) {
  const test::TempFolder folder;
  PointCloud points;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { write_kitti_bin(folder / "0.bin", points); }, "not 0");
  points.x.resize(kMaxScanPoints + 1);
  points.y.resize(kMaxScanPoints + 1);
  points.z.resize(kMaxScanPoints + 1);
  expect_error(
      ErrorCode::kInvalidArgument, [&] { write_kitti_bin(folder / "0.bin", points); }, "2000001");
  EXPECT_FALSE(exists(folder / "0.bin"));
}

}  // namespace
}  // namespace cellmap
