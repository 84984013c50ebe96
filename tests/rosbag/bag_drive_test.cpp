#include "cellmap/rosbag/bag_drive.hpp"

#include <gmock/gmock.h>

#include <cstring>
#include <fstream>
#include <functional>
#include <iterator>

#include "cellmap/core/error.hpp"
#include "rosbag/bag_writer.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::ros_bag {
namespace {

using test::BagWriter;
using test::Cloud;
using test::expect_error;

constexpr int kRows = 2, kColumns = 50;
constexpr const char* kCompressions[] = {"none", "bz2", "lz4"};

/// Two rows of points (scan + i / 100, -i, 0.5), intensity before each and padding behind each row.
template <typename Real>
Cloud cloud_of(int scan, double stamp_s) {
  const std::uint8_t type = sizeof(Real) == 4 ? 7 : 8;
  const std::uint32_t step = 4 + 3 * sizeof(Real) + 2;
  Cloud cloud{.stamp_s = stamp_s,
              .height = kRows,
              .width = kColumns,
              .point_step = step,
              .row_step = step * kColumns + 7,
              .fields = {{"intensity", 0, 7},
                         {"z", 4, type},
                         {"y", 4 + sizeof(Real), type},
                         {"x", 4 + 2 * sizeof(Real), type}},
              .data = {}};
  cloud.data.resize(kRows * cloud.row_step);
  for (int i = 0; i < kRows * kColumns; ++i) {
    const Real zyx[3] = {Real(0.5), Real(-i), Real(scan + i / 100.0)};
    auto* point = &cloud.data[i / kColumns * cloud.row_step + i % kColumns * step];
    std::memcpy(point + 4, zyx, sizeof(zyx));
  }
  return cloud;
}

class BagDrive : public ::testing::Test {
 protected:
  /// Ten scans from 1.0 s to 1.9 s, odometry from 1.15 s to 1.83 s.
  std::filesystem::path write(const char* compression = "lz4", const char* child = "velodyne") {
    const auto file = folder_ / "drive.bag";
    BagWriter bag(file, compression);
    for (int i = 0; i < 35; ++i) {  // straight ahead at 10 m/s
      const double stamp_s = 1.15 + 0.02 * i;
      bag.odometry("/odom", stamp_s, child, 10 * stamp_s, 0, 0);
    }
    for (int i = 9; i >= 0; --i) {  // the latest first: what counts is a message's own time
      bag.cloud("/points", 100 - i, cloud_of<float>(i, 1 + 0.1 * i));
    }
    return file;
  }

  std::string bytes_of(const std::filesystem::path& file) {
    std::ifstream in(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  test::TempFolder folder_;
};

void read_all(const std::filesystem::path& file) {
  const auto drive = open_bag(file);
  while (drive->next()) {
  }
}

TEST_F(BagDrive, ScansComeByTheirTimeWithOdometryBetweenItsPoses) {
  for (const char* compression : kCompressions) {
    const auto drive = open_bag(write(compression));
    ASSERT_EQ(drive->size(), 7u);  // 1.2 s to 1.8 s
    for (int i = 0; i < 7; ++i) {
      const auto scan = drive->next();
      ASSERT_TRUE(scan);
      EXPECT_EQ(scan->index, static_cast<std::size_t>(i));
      const double stamp = 1.2 + 0.1 * i;
      EXPECT_NEAR(to_seconds(scan->stamp), stamp, 1e-8);
      EXPECT_NEAR(scan->T_odom_sensor.translation().x(), 10 * stamp, 1e-6);
      ASSERT_EQ(scan->points.size(), static_cast<std::size_t>(kRows * kColumns));
      for (std::size_t k : {0u, 49u, 50u, 99u}) {
        const Eigen::Vector3f expected(2.0f + i + k / 100.0f, -static_cast<float>(k), 0.5f);
        EXPECT_LT((scan->points[k] - expected).norm(), 1e-5);
      }
    }
    EXPECT_FALSE(drive->next());
    drive->seek(3);
    EXPECT_NEAR(to_seconds(drive->next()->stamp), 1.5, 1e-8);
  }
}

TEST_F(BagDrive, DoublesAreReadAndPosesMayComeStampedOrFromAFile) {
  const auto file = folder_ / "doubles.bag";
  {
    BagWriter bag(file, "none");
    bag.cloud("/points", 1, cloud_of<double>(3, 1.5));
    for (const double stamp_s : {1.0, 2.0}) bag.pose("/pose", stamp_s, 0, stamp_s, 0);
  }
  const auto scan = open_bag(file)->next();
  EXPECT_NEAR(scan->T_odom_sensor.translation().y(), 1.5, 1e-9);
  EXPECT_NEAR(scan->points[99].x(), 3.99f, 1e-5);
  folder_.write("poses.tum", "1 0 0 7 0 0 0 1\n2 0 0 9 0 0 0 1\n");
  const auto other = open_bag(file, {.poses = folder_ / "poses.tum"})->next();
  EXPECT_NEAR(other->T_odom_sensor.translation().z(), 8, 1e-9);
}

TEST_F(BagDrive, OdometryOfAnotherFrameIsRefusedUnlessAFileHasThePosesOfTheSensor) {
  const auto file = write("lz4", "base_link");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_bag(file); }, "base_link", "velodyne", "TUM");
  folder_.write("poses.tum", "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n");
  EXPECT_EQ(open_bag(file, {.poses = folder_ / "poses.tum"})->size(), 10u);
}

TEST_F(BagDrive, OfSeveralTopicsOneIsNamed) {
  const auto file = folder_ / "two.bag";
  {
    BagWriter bag(file, "none");
    bag.cloud("/left", 1, cloud_of<float>(1, 1.5));
    bag.cloud("/right", 1, cloud_of<float>(2, 1.5));
    for (const double stamp_s : {1.0, 2.0}) bag.odometry("/odom", stamp_s, "", 0, 0, 0);
  }
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_bag(file); }, "/left, /right", "name the one");
  EXPECT_NEAR(open_bag(file, {.points_topic = "/right"})->next()->points[0].x(), 2, 1e-6);
  expect_error(
      ErrorCode::kNotFound, [&] { open_bag(file, {.points_topic = "/odom"}); }, "/left, /right");
}

TEST_F(BagDrive, WhatIsNoBagOrHasNoScansIsSaidToBe) {
  expect_error(
      ErrorCode::kNotFound, [&] { open_bag(folder_ / "nowhere.bag"); }, "nowhere.bag");
  folder_.write("text.bag", "SQLite format 3 and so on");
  expect_error(
      ErrorCode::kUnsupported, [&] { open_bag(folder_ / "text.bag"); }, "ROS 2");
  BagWriter(folder_ / "empty.bag", "none");
  expect_error(
      ErrorCode::kNotFound, [&] { open_bag(folder_ / "empty.bag"); }, "PointCloud2");
}

TEST_F(BagDrive, ABagThatWasCutOffIsRefusedUnlessItEndsBetweenRecords) {
  const std::string whole = bytes_of(write());
  std::size_t cuts = 0, refused = 0;
  for (std::size_t size = 0; size < whole.size(); size += 1 + whole.size() / 400) {
    folder_.write("cut.bag", whole.substr(0, size));
    ++cuts;
    try {
      read_all(folder_ / "cut.bag");
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, cuts * 9 / 10);
}

TEST_F(BagDrive, WhateverByteIsWrongTheReaderStaysWithinTheFile) {
  for (const char* compression : kCompressions) {
    const std::string whole = bytes_of(write(compression));
    for (std::size_t i = 0; i < 600; ++i) {
      std::string broken = whole;
      // Most of them near the beginning, where the lengths are.
      const std::size_t at = i < 300 ? 13 + i : (i * 7919) % whole.size();
      broken[at] = static_cast<char>(broken[at] ^ (i % 2 == 0 ? 0xff : 1 << (i % 8)));
      folder_.write("broken.bag", broken);
      try {
        read_all(folder_ / "broken.bag");
      } catch (const Error&) {
      }
    }
  }
}

TEST_F(BagDrive, AScanThatClaimsMorePointsThanItHasIsRefused) {
  for (const auto& lie : std::vector<std::function<void(Cloud&)>>{
           [](auto& cloud) { cloud.width = cloud.height = 0xffffffff; },
           [](auto& cloud) { cloud.width = 60; }, [](auto& cloud) { cloud.height = 3; },
           [](auto& cloud) { cloud.row_step = 0xffffffff; },
           [](auto& cloud) { cloud.point_step = 8; }, [](auto& cloud) { cloud.data.resize(9); },
           [](auto& cloud) { cloud.fields[1].offset = 0xfffffff0; },
           [](auto& cloud) { cloud.fields.pop_back(); },
           [](auto& cloud) { cloud.is_big_endian = true; }, [](auto& cloud) { cloud.width = 0; }}) {
    auto cloud = cloud_of<float>(0, 1.5);
    lie(cloud);
    const auto file = folder_ / "lie.bag";
    {
      BagWriter bag(file, "none");
      bag.cloud("/points", 1, cloud);
      for (const double stamp_s : {1.0, 2.0}) bag.odometry("/odom", stamp_s, "velodyne", 0, 0, 0);
    }
    EXPECT_THROW(read_all(file), Error);
  }
}

}  // namespace
}  // namespace cellmap::ros_bag
