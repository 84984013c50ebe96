#include <gtest/gtest.h>

#include "cellmap/pcl/scan_file.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "support/drive_check.hpp"
#include "support/real_data.hpp"

namespace cellmap {
namespace {

using test::expect_drive;
using test::real_data;

std::unique_ptr<ScanSource> open(const std::filesystem::path& folder, const char* poses) {
  return open_dataset(folder, {poses, PoseFrame::kAuto, pcl_io::read_scan_file});
}

TEST(RealPcdDataset, MulranHasMorePosesAndTimesThanScans) {
  const auto folder = real_data("mulran-kaist03");
  if (!exists(folder)) GTEST_SKIP() << "no " << folder;
  const auto source = open(folder, "optimized_poses.txt");
  expect_drive(*source, {21, 30'000, 66'000, {0, 0, 0}, 1, 0.2, 6});
  source->seek(0);
  EXPECT_EQ(source->next()->stamp, 1'567'410'201'745'204'700);
}

TEST(RealPcdDataset, LivoxOpensWithItsOdometryAndItsOptimisedPoses) {
  const auto folder = real_data("livox-hku1");
  if (!exists(folder)) GTEST_SKIP() << "no " << folder;
  for (const char* poses : {"odom_poses.txt", "optimized_poses.txt"}) {
    SCOPED_TRACE(poses);
    const auto source = open(folder, poses);
    expect_drive(*source, {314, 1'000, 12'000, {0.0116837, -0.022779, -0.0122925}, 1, 0.3, 20});
  }
}

}  // namespace
}  // namespace cellmap
