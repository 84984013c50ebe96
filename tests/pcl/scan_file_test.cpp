#include "cellmap/pcl/scan_file.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <fstream>
#include <random>
#include <sstream>

#include "cellmap/core/error.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::pcl_io {
namespace {

using test::expect_error;
using test::TempFolder;

template <typename T>
std::string bytes_of(const std::vector<T>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

std::string pcd(const std::string& points, const std::string& data, const std::string& body) {
  return "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\n"
         "TYPE F F F\nCOUNT 1 1 1\nWIDTH " +
         points + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + points + "\nDATA " + data +
         "\n" + body;
}

std::string ply(const std::string& points, const std::string& format, const std::string& body) {
  return "ply\nformat " + format + " 1.0\ncomment of someone\nelement vertex " + points +
         "\nproperty float x\nproperty float y\nproperty float z\nend_header\n" + body;
}

/// LZF that copies nothing: runs of up to 32 literal bytes; its two sizes first, as PCD has them.
std::string compressed(const std::string& bytes) {
  std::string packed;
  for (std::size_t i = 0; i < bytes.size(); i += 32) {
    const std::string run = bytes.substr(i, 32);
    packed += static_cast<char>(run.size() - 1);
    packed += run;
  }
  return bytes_of<std::uint32_t>({static_cast<std::uint32_t>(packed.size()),
                                  static_cast<std::uint32_t>(bytes.size())}) +
         packed;
}

std::string read_bytes(const std::filesystem::path& file) {
  std::ostringstream bytes;
  bytes << std::ifstream(file, std::ios::binary).rdbuf();
  return bytes.str();
}

const std::vector<float> kTwoPoints = {1, 2, 3, -4.5F, 5, 6e-2F};
const std::vector<float> kTwoPointsByField = {1, -4.5F, 2, 5, 3, 6e-2F};

void expect_two_points(const std::filesystem::path& file) {
  const PointCloud points = read_scan_file(file);
  ASSERT_EQ(points.size(), 2U);
  EXPECT_EQ(points[0], Eigen::Vector3f(1, 2, 3)) << file;
  EXPECT_EQ(points[1], Eigen::Vector3f(-4.5F, 5, 6e-2F)) << file;
}

TEST(ScanFile, ReadsPcdAsciiBinaryAndCompressed) {
  const TempFolder folder;
  expect_two_points(folder.write("a.pcd", pcd("2", "ascii", "1 2 3\n-4.5 5 6e-2\n")));
  expect_two_points(folder.write("b.PCD", pcd("2", "binary", bytes_of(kTwoPoints))));
  expect_two_points(folder.write(
      "c.pcd", pcd("2", "binary_compressed", compressed(bytes_of(kTwoPointsByField)))));
}

TEST(ScanFile, ReadsPlyAsciiAndBinaryOfBothByteOrders) {
  const TempFolder folder;
  expect_two_points(folder.write("a.ply", ply("2", "ascii", "1 2 3\n-4.5 5 6e-2\n")));
  const std::string little = bytes_of(kTwoPoints);
  expect_two_points(folder.write("b.ply", ply("2", "binary_little_endian", little)));
  std::string big;
  for (std::size_t i = 0; i < little.size(); i += 4) {
    const std::string word = little.substr(i, 4);
    big.append(word.rbegin(), word.rend());
  }
  expect_two_points(folder.write("c.ply", ply("2", "binary_big_endian", big)));
}

TEST(ScanFile, OtherFieldsAndDoublesAreNoHindrance) {
  const TempFolder folder;
  const std::string header =
      "VERSION 0.7\nFIELDS ring z intensity x y\nSIZE 2 8 4 8 8\nTYPE U F F F F\n"
      "COUNT 1 1 2 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA binary\n";
  const std::string body = bytes_of<std::uint16_t>({7}) + bytes_of<double>({3}) +
                           bytes_of<float>({8, 9}) + bytes_of<double>({1, 2});
  const PointCloud points = read_scan_file(folder.write("a.pcd", header + body));
  ASSERT_EQ(points.size(), 1U);
  EXPECT_EQ(points[0], Eigen::Vector3f(1, 2, 3));
}

TEST(ScanFile, NanPointsAreKept) {
  const TempFolder folder;
  const PointCloud points =
      read_scan_file(folder.write("a.pcd", pcd("2", "ascii", "nan nan nan\n1 2 3\n")));
  ASSERT_EQ(points.size(), 2U);
  EXPECT_TRUE(std::isnan(points.x[0]));
  EXPECT_EQ(points[1], Eigen::Vector3f(1, 2, 3));
}

TEST(ScanFile, WhatIsWrittenReadsBackTheSameWithAndWithoutNormals) {
  const TempFolder folder;
  PointCloud points, normals;
  for (int i = 0; i < 1000; ++i) {
    const auto v = static_cast<float>(i);
    points.push_back({v / 3, -v, 1 / (v + 1)});
    normals.push_back({0, 0, 1});
  }
  for (const std::string name : {"a.pcd", "a.ply"}) {
    for (const bool with_normals : {false, true}) {
      write_cloud(folder / name, points, with_normals ? &normals : nullptr);
      const PointCloud read = read_scan_file(folder / name);
      EXPECT_EQ(read.x, points.x) << name;
      EXPECT_EQ(read.y, points.y) << name;
      EXPECT_EQ(read.z, points.z) << name;
    }
  }
}

TEST(ScanFile, WrittenFilesHaveTheConventionalNamesAndTheirBytes) {
  const TempFolder folder;
  PointCloud points, normals;
  points.push_back({1, 2, 3});
  normals.push_back({0, 0.6F, 0.8F});
  const std::string row = bytes_of<float>({1, 2, 3, 0, 0.6F, 0.8F});
  write_cloud(folder / "a.pcd", points, &normals);
  const std::string pcd_bytes = read_bytes(folder / "a.pcd");
  EXPECT_NE(pcd_bytes.find("FIELDS x y z normal_x normal_y normal_z\n"), std::string::npos);
  EXPECT_TRUE(pcd_bytes.ends_with("DATA binary\n" + row));
  write_cloud(folder / "a.ply", points, &normals);
  const std::string ply_bytes = read_bytes(folder / "a.ply");
  EXPECT_NE(ply_bytes.find("property float nz\n"), std::string::npos);
  EXPECT_NE(ply_bytes.find("end_header\n" + row), std::string::npos);
}

TEST(ScanFile, WhatCannotBeWrittenIsRefused) {
  const TempFolder folder;
  PointCloud points;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { write_cloud(folder / "a.pcd", points); }, "found none");
  points.push_back({1, 2, 3});
  const PointCloud no_normals;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { write_cloud(folder / "a.pcd", points, &no_normals); },
      "found 0");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { write_cloud(folder / "a.las", points); }, ".pcd or .ply");
  for (const std::string name : {"none/a.pcd", "none/a.ply"}) {
    expect_error(
        ErrorCode::kIo, [&] { write_cloud(folder / name, points); }, name);
  }
}

TEST(ScanFile, AHeaderThatAnnouncesMoreThanTheFileHoldsIsRefusedUnread) {
  const TempFolder folder;
  const std::string body = bytes_of(kTwoPoints);
  const struct {
    std::string points;
    ErrorCode code;
  } cases[] = {{"1000000000000", ErrorCode::kTooLarge},
               {"2000001", ErrorCode::kTooLarge},
               {"2000000", ErrorCode::kCorruptData},
               {"3", ErrorCode::kCorruptData},
               {"0", ErrorCode::kCorruptData},
               {"-1", ErrorCode::kCorruptData},
               {"99999999999999999999", ErrorCode::kCorruptData},
               {"1e1", ErrorCode::kCorruptData}};
  for (const auto& bad : cases) {
    for (const char* data : {"ascii", "binary", "binary_compressed"}) {
      const auto file = folder.write("a.pcd", pcd(bad.points, data, body));
      expect_error(
          bad.code, [&] { read_scan_file(file); }, "a.pcd:");
    }
    for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
      const auto file = folder.write("a.ply", ply(bad.points, format, body));
      // Three ASCII vertices could hide in 24 bytes: there PCL finds out, without a line.
      expect_error(
          bad.code, [&] { read_scan_file(file); }, "a.ply");
    }
  }
}

TEST(ScanFile, EveryTruncationIsRefused) {
  const TempFolder folder;
  const std::pair<const char*, std::string> wholes[] = {
      {"a.pcd", pcd("2", "binary", bytes_of(kTwoPoints))},
      {"a.pcd", pcd("2", "binary_compressed", compressed(bytes_of(kTwoPointsByField)))},
      {"a.pcd", pcd("2", "ascii", "1 2 3\n4 5 6")},
      {"a.ply", ply("2", "binary_little_endian", bytes_of(kTwoPoints))},
      {"a.ply", ply("2", "ascii", "1 2 3\n4 5 6")},
  };
  for (const auto& [name, whole] : wholes) {
    EXPECT_EQ(read_scan_file(folder.write(name, whole)).size(), 2U);
    for (std::size_t length = 0; length < whole.size(); ++length) {
      const auto file = folder.write(name, whole.substr(0, length));
      try {
        read_scan_file(file);
        ADD_FAILURE() << name << " read with " << length << " of " << whole.size() << " bytes";
      } catch (const Error& error) {
        const bool refused = error.code() == ErrorCode::kCorruptData ||
                             error.code() == ErrorCode::kUnsupported;  // "DATA bin"
        EXPECT_TRUE(refused) << error.what();
      }
    }
  }
}

TEST(ScanFile, MalformedPcdHeadersAreNamedByLine) {
  const TempFolder folder;
  const std::string good = pcd("2", "binary", bytes_of(kTwoPoints));
  const struct {
    std::string from, to, says;
    ErrorCode code = ErrorCode::kCorruptData;
  } cases[] = {
      {"FIELDS x y z", "FIELDS x y w", "\"x\" \"y\" \"w\""},
      {"FIELDS x y z", "FIELDS x y y", "once each"},
      {"FIELDS x y z", "FIELDZ x y z", "found \"FIELDZ\""},
      {"FIELDS x y z\n", "", "expected FIELDS"},
      {"SIZE 4 4 4\n", "SIZE 4 4\n", "expected 3 values of SIZE, found 2"},
      {"SIZE 4 4 4", "SIZE 4 4 3", "\"F 3\""},
      {"SIZE 4 4 4", "SIZE 4 4 four", "\"four\""},
      {"TYPE F F F", "TYPE F F Q", "\"Q 4\""},
      {"TYPE F F F", "TYPE F F I", "as one float", ErrorCode::kUnsupported},
      {"COUNT 1 1 1", "COUNT 1 1 2", "as one float", ErrorCode::kUnsupported},
      {"COUNT 1 1 1", "COUNT 1 1 0", "COUNT"},
      {"COUNT 1 1 1", "COUNT 1 1 99999", "COUNT"},
      {"WIDTH 2", "WIDTH 3", "WIDTH x HEIGHT"},
      {"HEIGHT 1", "HEIGHT 0", "WIDTH x HEIGHT"},
      {"HEIGHT 1", "HEIGHT 9223372036854775808", "whole number"},
      {"POINTS 2", "POINTS 2\nPOINTS 2", "twice"},
      {"DATA binary", "DATA text", "\"text\"", ErrorCode::kUnsupported},
      {"DATA binary\n", "", "expected a PCD header line"},
  };
  for (const auto& bad : cases) {
    std::string text = good;
    text.replace(text.find(bad.from), bad.from.size(), bad.to);
    const auto file = folder.write("a.pcd", text);
    expect_error(
        bad.code, [&] { read_scan_file(file); }, "a.pcd:", bad.says);
  }
}

TEST(ScanFile, MalformedPlyHeadersAreNamedByLine) {
  const TempFolder folder;
  const std::string good = ply("2", "binary_little_endian", bytes_of(kTwoPoints));
  const struct {
    std::string from, to, says;
    ErrorCode code = ErrorCode::kCorruptData;
  } cases[] = {
      {"ply\n", "PLY?\n", "expected a PLY file"},
      {"property float z\n", "", "\"x\" \"y\""},
      {"property float z\n", "property float x\n", "once each"},
      {"property float z\n", "property list uchar int z\n", "once each"},
      {"property float z\n", "property int z\n", "float or double", ErrorCode::kUnsupported},
      {"property float z\n", "property quad z\n", "\"quad\""},
      {"element vertex 2\n", "", "before its properties"},
      {"element vertex 2\n", "element point 2\n", "\"vertex\""},
      {"element vertex 2\n", "element vertex 2\nelement vertex 2\n", "two elements"},
      {"end_header\n", "element face 3\nproperty list uchar int vertex_indices\nend_header\n",
       "a mesh", ErrorCode::kUnsupported},
      {"end_header\n", "element extra 9999999999\nproperty int a\nend_header\n", "cut off"},
      {"end_header\n", "obj_info num_cols 1000000\nend_header\n", "range grids",
       ErrorCode::kUnsupported},
      {"binary_little_endian", "binary_middle_endian", "\"binary_middle_endian\"",
       ErrorCode::kUnsupported},
      {"comment of someone", "remark of someone", "\"remark\""},
  };
  for (const auto& bad : cases) {
    std::string text = good;
    text.replace(text.find(bad.from), bad.from.size(), bad.to);
    const auto file = folder.write("a.ply", text);
    expect_error(
        bad.code, [&] { read_scan_file(file); }, "a.ply:", bad.says);
  }
}

TEST(ScanFile, WordsThatAreNoNumbersAreNotReadAsZero) {
  const TempFolder folder;
  const auto pcd_file = folder.write("a.pcd", pcd("2", "ascii", "1 2 3\n4 five 6\n"));
  expect_error(
      ErrorCode::kCorruptData, [&] { read_scan_file(pcd_file); }, "a.pcd:13:", "\"five\"");
  const auto short_row = folder.write("b.pcd", pcd("2", "ascii", "1 2 3\n4 5\n   \n"));
  expect_error(
      ErrorCode::kCorruptData, [&] { read_scan_file(short_row); }, "b.pcd:13:", "found 2");
  const auto ply_file = folder.write("a.ply", ply("2", "ascii", "1 2 3\n4 five 6\n"));
  expect_error(
      ErrorCode::kCorruptData, [&] { read_scan_file(ply_file); }, "a.ply");
}

TEST(ScanFile, DamagedCompressionIsAnError) {
  const TempFolder folder;
  const auto sizes = bytes_of<std::uint32_t>({26, 24});
  const std::string rubbish(26, '\xff');  // copies from before the beginning
  const auto file = folder.write("a.pcd", pcd("2", "binary_compressed", sizes + rubbish));
  expect_error(
      ErrorCode::kCorruptData, [&] { read_scan_file(file); }, "a.pcd");
  const auto bomb = bytes_of<std::uint32_t>({10, 24'000'000}) + std::string(10, 'x');
  const auto bomb_file = folder.write("b.pcd", pcd("2000000", "binary_compressed", bomb));
  expect_error(
      ErrorCode::kCorruptData, [&] { read_scan_file(bomb_file); }, "b.pcd:", "24000000");
}

TEST(ScanFile, RandomDamageGivesAnErrorOrAsManyPointsAsAllowed) {
  const TempFolder folder;
  const std::pair<const char*, std::string> wholes[] = {
      {"a.pcd", pcd("2", "binary", bytes_of(kTwoPoints))},
      {"a.pcd", pcd("2", "binary_compressed", compressed(bytes_of(kTwoPointsByField)))},
      {"a.pcd", pcd("2", "ascii", "1 2 3\n4 5 6\n")},
      {"a.ply", ply("2", "binary_little_endian", bytes_of(kTwoPoints))},
      {"a.ply", ply("2", "binary_big_endian", bytes_of(kTwoPoints))},
      {"a.ply", ply("2", "ascii", "1 2 3\n4 5 6\n")},
  };
  const std::string bytes = std::string("0123456789 \n\t-.#xyzFUIlist\xff\x80") + '\0';
  std::mt19937 rng(1);
  for (int round = 0; round < 1500; ++round) {
    const auto& [name, whole] = wholes[round % 6];
    std::string damaged = whole;
    for (unsigned i = 0; i <= rng() % 4; ++i) {
      const std::size_t at = rng() % damaged.size();
      if (rng() % 3 == 0) {
        damaged.insert(at, 1, bytes[rng() % bytes.size()]);
      } else {
        damaged[at] = bytes[rng() % bytes.size()];
      }
    }
    try {
      const PointCloud points = read_scan_file(folder.write(name, damaged));
      EXPECT_LE(points.size(), damaged.size());
      EXPECT_EQ(points.x.size(), points.z.size());
    } catch (const Error&) {
    }
  }
}

TEST(ScanFile, NothingIsPrinted) {
  const TempFolder folder;
  const auto bad_ply = folder.write("a.ply", ply("2", "ascii", "1 2 3\n4 five 6\n"));
  const auto bad_pcd = folder.write(
      "a.pcd",
      pcd("2", "binary_compressed", bytes_of<std::uint32_t>({26, 24}) + std::string(26, '\xff')));
  PointCloud points;
  points.push_back({1, 2, 3});
  testing::internal::CaptureStderr();
  testing::internal::CaptureStdout();
  for (const auto& file : {bad_ply, bad_pcd}) EXPECT_THROW(read_scan_file(file), Error);
  EXPECT_THROW(write_cloud(folder / "none/a.ply", points), Error);
  EXPECT_THROW(write_cloud(folder / "none/a.pcd", points), Error);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
}

TEST(ScanFile, AMissingFileAndAForeignExtensionAreSaidSo) {
  const TempFolder folder;
  expect_error(
      ErrorCode::kNotFound, [&] { read_scan_file(folder / "no.pcd"); }, "no.pcd");
  expect_error(
      ErrorCode::kNotFound, [&] { read_scan_file(folder / "no.ply"); }, "no.ply");
  expect_error(
      ErrorCode::kUnsupported, [&] { read_scan_file(folder / "a.las"); }, "a.las");
}

}  // namespace
}  // namespace cellmap::pcl_io
