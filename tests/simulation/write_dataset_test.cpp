#include <gtest/gtest.h>

#include <fstream>
#include <sstream>
#include <string>

#include "cellmap/simulation/simulator.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

std::unique_ptr<ScanSource> small_drive(std::size_t scans) {
  SimulatorOptions options;
  options.scans = scans;
  options.lidar.columns = 200;
  return simulate(options);
}

TEST(WriteDataset, GivesADataSetThatReadsBackAsItWas) {
  const test::TempFolder folder;
  const auto drive = small_drive(5);
  drive->seek(3);  // wherever the source stands, the whole drive is written
  std::size_t reported = 0;
  write_dataset(*drive, folder / "new/drive", {}, [&](const Progress& progress) {
    EXPECT_EQ(progress.scans_total, 5u);
    EXPECT_EQ(progress.scans_done, ++reported);
  });
  EXPECT_EQ(reported, 5u);

  const auto written = open_dataset(folder / "new/drive");
  ASSERT_EQ(written->size(), 5u);
  drive->seek(0);
  for (std::size_t i = 0; i < 5; ++i) {
    const auto expected = drive->next(), found = written->next();
    EXPECT_EQ(found->points.x, expected->points.x);
    EXPECT_EQ(found->points.y, expected->points.y);
    EXPECT_EQ(found->points.z, expected->points.z);
    EXPECT_EQ(found->stamp, expected->stamp);
    EXPECT_TRUE(found->T_odom_sensor.isApprox(expected->T_odom_sensor, 1e-9)) << "row " << i;
  }
  const Trajectory truth = read_kitti_trajectory(folder / "new/drive/poses_gt.txt");
  ASSERT_EQ(truth.size(), 5u);
  EXPECT_TRUE(truth[4].pose.isApprox(drive->ground_truth()[4].pose, 1e-9));
}

TEST(WriteDataset, NeverWritesOverAnotherDataSet) {
  const test::TempFolder folder;
  const auto drive = small_drive(1);
  write_dataset(*drive, folder.path());
  test::expect_error(
      ErrorCode::kAlreadyExists, [&] { write_dataset(*drive, folder.path()); }, "velodyne");

  const test::TempFolder with_poses;
  with_poses.write("poses.txt", "mine");
  test::expect_error(
      ErrorCode::kAlreadyExists, [&] { write_dataset(*drive, with_poses.path()); }, "poses.txt");
  std::ostringstream kept;
  kept << std::ifstream(with_poses / "poses.txt").rdbuf();
  EXPECT_EQ(kept.str(), "mine");
}

TEST(WriteDataset, LeavesNothingBehindWhenStopped) {
  const test::TempFolder folder;
  const auto drive = small_drive(5);
  std::stop_source stop;
  const auto stop_after_two = [&](const Progress& progress) {
    if (progress.scans_done == 2) stop.request_stop();
  };
  test::expect_error(
      ErrorCode::kCancelled,
      [&] { write_dataset(*drive, folder / "drive", stop.get_token(), stop_after_two); }, "");
  EXPECT_FALSE(std::filesystem::exists(folder / "drive"));

  write_dataset(*drive, folder / "drive");
  EXPECT_EQ(open_dataset(folder / "drive")->size(), 5u);
}

TEST(WriteDataset, SaysSoWhereItCannotWrite) {
  const test::TempFolder folder;
  const auto drive = small_drive(1);
  folder.write("file", "not a folder");
  test::expect_error(
      ErrorCode::kIo, [&] { write_dataset(*drive, folder / "file/drive"); }, "file");
}

}  // namespace
}  // namespace cellmap
