#include <gtest/gtest.h>

#include "cellmap/scan/scan_source.hpp"
#include "support/drive_check.hpp"
#include "support/real_data.hpp"

namespace cellmap {
namespace {

using test::expect_drive;
using test::real_data;

TEST(RealDataset, Kitti00ConsecutiveHasCameraPosesThatBecomeTheSensors) {
  const auto folder = real_data("kitti00-consecutive");
  if (!exists(folder)) GTEST_SKIP() << "no " << folder;
  const auto source = open_dataset(folder);
  expect_drive(*source, {16, 100'000, 130'000, {0, 0, 0}, 3, 0.15, 4});
  source->seek(1);
  const auto second = source->next();
  EXPECT_EQ(second->stamp, 103'600'000);
  EXPECT_NEAR(second->T_odom_sensor.translation().x(), 0.68, 0.02);  // KITTI cars drive forward
  EXPECT_TRUE(source->ground_truth().empty());
}

TEST(RealDataset, Kitti00DenseOpensWithItsOdometryAndWithItsTruth) {
  const auto folder = real_data("kitti00-dense");
  if (!exists(folder)) GTEST_SKIP() << "no " << folder;
  for (const char* poses : {"odom_ndt.txt", "poses_gt.txt"}) {
    const auto source = open_dataset(folder, {poses, PoseFrame::kAuto, {}});
    expect_drive(*source, {40, 100'000, 130'000, {0.687383, 0.55236, 0.786151}, 1, 0.15, 4});
    EXPECT_EQ(source->ground_truth().size(), 40U);
    EXPECT_NEAR(source->ground_truth().length_m(), 75, 5);
  }
}

TEST(RealDataset, Kitti00KeyframesOpenWithEachOfTheirFiveOdometries) {
  const auto folder = real_data("kitti00-keyframes");
  if (!exists(folder)) GTEST_SKIP() << "no " << folder;
  for (const char* poses : {"odom_cvo_geometric.txt", "odom_gicp_f2f.txt", "odom_kiss_icp.txt",
                            "odom_ndt_f2f.txt", "odom_simple_online.txt"}) {
    SCOPED_TRACE(poses);
    const auto source = open_dataset(folder, {poses, PoseFrame::kAuto, {}});
    expect_drive(*source, {664, 3'000, 12'000, {0, 0, 0}, 1, 0.35, 20});
    EXPECT_EQ(source->ground_truth().size(), 664U);
  }
}

}  // namespace
}  // namespace cellmap
