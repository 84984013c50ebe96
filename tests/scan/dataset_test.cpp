#include <gtest/gtest.h>

#include <numbers>

#include "cellmap/scan/scan_source.hpp"
#include "support/expect_error.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using test::expect_error;
using test::TempFolder;

constexpr const char* kTr = "P0: 7 0 0\nTr: 0 -1 0 0.5 0 0 -1 0 1 0 0 -0.25\n";

/// A scan whose first point carries `mark`, so that order shows.
std::string scan_bytes(float mark) {
  const float row[4] = {mark, 0, 0, 0};
  return std::string(reinterpret_cast<const char*>(row), sizeof(row));
}

/// KITTI rows of poses without rotation at x = 0, 1, 2, ...
std::string straight_poses(int count) {
  std::string text;
  for (int i = 0; i < count; ++i) text += "1 0 0 " + std::to_string(i) + " 0 1 0 0 0 0 1 0\n";
  return text;
}

void write_scans(const TempFolder& folder, const std::vector<std::string>& names) {
  for (std::size_t i = 0; i < names.size(); ++i) {
    folder.write(names[i], scan_bytes(static_cast<float>(i)));
  }
}

/// velodyne/000000.bin ..., poses.txt and times.txt, all consistent.
void write_drive(const TempFolder& folder, int scans) {
  std::string times;
  for (int i = 0; i < scans; ++i) {
    folder.write("velodyne/00000" + std::to_string(i) + ".bin", scan_bytes(static_cast<float>(i)));
    times += std::to_string(10 + i) + ".5\n";
  }
  folder.write("times.txt", times);
  folder.write("poses.txt", straight_poses(scans));
}

std::vector<PosedScan> read_all(ScanSource& source) {
  std::vector<PosedScan> scans;
  while (auto scan = source.next()) scans.push_back(std::move(*scan));
  return scans;
}

TEST(Dataset, StreamsScansWithTheirPosesAndTimes) {
  const TempFolder folder;
  write_drive(folder, 4);
  const auto source = open_dataset(folder.path());
  EXPECT_EQ(source->size(), 4U);
  ASSERT_EQ(source->odometry().size(), 4U);  // before a scan is read
  const std::vector<PosedScan> scans = read_all(*source);
  ASSERT_EQ(scans.size(), 4U);
  for (std::size_t i = 0; i < scans.size(); ++i) {
    EXPECT_EQ(source->odometry()[i].matrix(), scans[i].T_odom_sensor.matrix());
    EXPECT_EQ(scans[i].index, i);
    EXPECT_EQ(scans[i].stamp, 10'500'000'000 + static_cast<Stamp>(i) * 1'000'000'000);
    EXPECT_EQ(scans[i].T_odom_sensor.translation(), Eigen::Vector3d(static_cast<double>(i), 0, 0));
    EXPECT_EQ(scans[i].points.x[0], static_cast<float>(i));
  }
  EXPECT_TRUE(source->ground_truth().empty());
}

TEST(Dataset, SeekGoesToAnyScanAndToTheEnd) {
  const TempFolder folder;
  write_drive(folder, 3);
  const auto source = open_dataset(folder.path());
  source->seek(2);
  EXPECT_EQ(source->next()->index, 2U);
  EXPECT_FALSE(source->next());
  source->seek(0);
  EXPECT_EQ(source->next()->index, 0U);
  source->seek(3);
  EXPECT_FALSE(source->next());
  expect_error(
      ErrorCode::kInvalidArgument, [&] { source->seek(4); }, "scan 4 of a drive of 3");
}

TEST(Dataset, WithoutTimesScansAreATenthOfASecondApart) {
  const TempFolder folder;
  write_drive(folder, 3);
  remove(folder / "times.txt");
  const auto source = open_dataset(folder.path());
  source->seek(2);
  EXPECT_EQ(source->next()->stamp, 200'000'000);
}

TEST(Dataset, ScansMayLieInVelodyneInScansOrInTheFolderItself) {
  for (const std::string place : {"velodyne/", "scans/", ""}) {
    const TempFolder folder;
    write_scans(folder, {place + "a.bin", place + "b.BIN"});
    folder.write(place + ".c.bin", "hidden");
    folder.write(place + "notes.md", "");
    folder.write("poses.txt", straight_poses(2));
    EXPECT_EQ(read_all(*open_dataset(folder.path())).size(), 2U) << place;
  }
}

TEST(Dataset, NumberedScansAreOrderedByNumberOthersByName) {
  const std::vector<std::vector<std::string>> orders = {
      {"0.bin", "1.bin", "2.bin", "10.bin"},
      {"key_frame_1.bin", "key_frame_2.bin", "key_frame_10.bin", "key_frame_0100.bin"},
      {"1577836980.1.bin", "1577836980.9.bin", "1577836981.0.bin"},
      {"10a.bin", "2b.bin", "c.bin"},
      {"1577836980099104600.bin", "1577836980099104601.bin"},
  };
  for (const std::vector<std::string>& names : orders) {
    const TempFolder folder;
    write_scans(folder, names);
    folder.write("poses.txt", straight_poses(static_cast<int>(names.size())));
    const std::vector<PosedScan> scans = read_all(*open_dataset(folder.path()));
    ASSERT_EQ(scans.size(), names.size());
    for (std::size_t i = 0; i < scans.size(); ++i) {
      EXPECT_EQ(scans[i].points.x[0], static_cast<float>(i)) << names[0];
    }
  }
}

TEST(Dataset, OwnPosesOfAFolderWithACalibrationAreTheCameras) {
  const TempFolder folder;
  write_drive(folder, 2);
  folder.write("calib.txt", kTr);
  // The camera looks along its z and the sensor along its x: forward for both.
  folder.write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 7\n");
  const auto scans = read_all(*open_dataset(folder.path()));
  EXPECT_LT((scans[0].T_odom_sensor.matrix() - Eigen::Matrix4d::Identity()).norm(), 1e-12);
  EXPECT_LT((scans[1].T_odom_sensor.translation() - Eigen::Vector3d(7, 0, 0)).norm(), 1e-12);
}

TEST(Dataset, ATurnOfTheCameraMovesTheSensorByItsLever) {
  const TempFolder folder;
  write_drive(folder, 2);
  folder.write("calib.txt", kTr);
  // Half a turn about the camera's y axis (down): the sensor, at (0.5, 0, -0.25) in the camera's
  // frame, swings to (-0.5, 0, 0.25), by (-1, 0, 0.5): in the sensor's axes x forward 0.5, y
  // left 1.
  folder.write("poses.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n-1 0 0 0 0 1 0 0 0 0 -1 0\n");
  const auto scans = read_all(*open_dataset(folder.path()));
  Pose expected = Pose::Identity();
  expected.linear() =
      Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  expected.translation() << 0.5, 1, 0;
  EXPECT_LT((scans[1].T_odom_sensor.matrix() - expected.matrix()).norm(), 1e-12);
}

TEST(Dataset, TheFrameOfPosesCanBeStated) {
  const TempFolder folder;
  write_drive(folder, 2);
  folder.write("calib.txt", kTr);
  folder.write("odometry.txt", straight_poses(2));
  const auto second_x = [&](DatasetOptions options) {
    return read_all(*open_dataset(folder.path(), options))[1].T_odom_sensor.translation().x();
  };
  // 1 m along x: forward for the sensor, to the right for the camera.
  EXPECT_NEAR(second_x({"odometry.txt", PoseFrame::kAuto, {}}), 1, 1e-12);
  EXPECT_NEAR(second_x({"odometry.txt", PoseFrame::kCamera, {}}), 0, 1e-12);
  EXPECT_NEAR(second_x({"", PoseFrame::kAuto, {}}), 0, 1e-12);
  EXPECT_NEAR(second_x({"", PoseFrame::kSensor, {}}), 1, 1e-12);
  EXPECT_NEAR(second_x({folder / "poses.txt", PoseFrame::kAuto, {}}), 0, 1e-12);
}

TEST(Dataset, TheCameraFrameNeedsACalibrationWithTr) {
  const TempFolder folder;
  write_drive(folder, 2);
  const auto open = [&](PoseFrame frame) { open_dataset(folder.path(), {"", frame, {}}); };
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open(PoseFrame::kCamera); }, "calib.txt", "Tr",
      "no such file");
  folder.write("calib.txt", "P0: 1 2 3\n");
  for (const PoseFrame frame : {PoseFrame::kCamera, PoseFrame::kAuto}) {
    expect_error(
        ErrorCode::kInvalidArgument, [&] { open(frame); }, "calib.txt", "Tr", "found none");
  }
  EXPECT_NO_THROW(open(PoseFrame::kSensor));
  folder.write("calib.txt", "P0: 1 2 3\nTr: 1 2 3\n");
  expect_error(
      ErrorCode::kCorruptData, [&] { open(PoseFrame::kAuto); }, "calib.txt:2:", "found 3");
  folder.write("calib.txt", "Tr: 2 0 0 0 0 2 0 0 0 0 2 0\n");
  expect_error(
      ErrorCode::kCorruptData, [&] { open(PoseFrame::kAuto); }, "calib.txt:1:", "rotation");
}

TEST(Dataset, GroundTruthIsInTheFrameOfTheFoldersPoses) {
  const TempFolder folder;
  write_drive(folder, 3);
  folder.write("poses_gt.txt", straight_poses(4));
  const auto truth_of = [&](DatasetOptions options) {
    const Trajectory truth = open_dataset(folder.path(), options)->ground_truth();
    EXPECT_EQ(truth.size(), 3U);
    EXPECT_EQ(truth[2].stamp, 12'500'000'000);
    return Eigen::Vector3d(truth[2].pose.translation());
  };
  EXPECT_LT((truth_of({}) - Eigen::Vector3d(2, 0, 0)).norm(), 1e-12);
  folder.write("calib.txt", kTr);
  EXPECT_LT((truth_of({}) - Eigen::Vector3d(0, -2, 0)).norm(), 1e-12);
  EXPECT_LT((truth_of({"", PoseFrame::kSensor, {}}) - Eigen::Vector3d(2, 0, 0)).norm(), 1e-12);
  folder.write("odometry.txt", straight_poses(3));
  EXPECT_LT((truth_of({"odometry.txt", PoseFrame::kSensor, {}}) - Eigen::Vector3d(0, -2, 0)).norm(),
            1e-12);
}

TEST(Dataset, ATumTrajectoryIsInterpolatedAtTheTimesOfTheScans) {
  const TempFolder folder;
  write_drive(folder, 3);
  folder.write("t.tum", "10 0 0 0 0 0 0 1\n11 2 0 0 0 0 0 1\n12.5 2 3 0 0 0 0 1\n");
  const auto scans = read_all(*open_dataset(folder.path(), {"t.tum", PoseFrame::kAuto, {}}));
  EXPECT_LT((scans[0].T_odom_sensor.translation() - Eigen::Vector3d(1, 0, 0)).norm(), 1e-12);
  EXPECT_LT((scans[1].T_odom_sensor.translation() - Eigen::Vector3d(2, 1, 0)).norm(), 1e-12);
  EXPECT_LT((scans[2].T_odom_sensor.translation() - Eigen::Vector3d(2, 3, 0)).norm(), 1e-12);
}

TEST(Dataset, ATumTrajectoryMustCoverTheScansAndNeedsTheirTimes) {
  const TempFolder folder;
  write_drive(folder, 3);
  folder.write("t.tum", "10 0 0 0 0 0 0 1\n12 2 0 0 0 0 0 1\n");
  const auto open = [&] { open_dataset(folder.path(), {"t.tum", PoseFrame::kAuto, {}}); };
  expect_error(ErrorCode::kCorruptData, open, "t.tum", "000002.bin", "12.500000000 s",
               "from 10.000000000 s to 12.000000000 s");
  remove(folder / "times.txt");
  expect_error(ErrorCode::kInvalidArgument, open, "t.tum", "no times.txt");
}

TEST(Dataset, FewerPosesOrTimesThanScansAreRefusedNamingTheFirstScanWithout) {
  for (const std::string name : {"poses.txt", "poses_gt.txt", "times.txt"}) {
    const TempFolder folder;
    write_drive(folder, 4);
    folder.write(name, name == "times.txt" ? "1\n2\n3\n" : straight_poses(3));
    expect_error(
        ErrorCode::kCorruptData, [&] { open_dataset(folder.path()); }, name, "expected 4",
        "found 3", "000003.bin");
  }
}

TEST(Dataset, FurtherRowsAreIgnoredOnlyWhereTheScansAreTheFirstOnes) {
  const TempFolder first;
  write_drive(first, 2);
  first.write("poses.txt", straight_poses(9));
  first.write("times.txt", "1\n2\n3\n");
  EXPECT_EQ(read_all(*open_dataset(first.path())).size(), 2U);

  for (const std::vector<std::string>& names :
       {std::vector<std::string>{"5.bin", "6.bin"}, {"0.bin", "2.bin"}, {"1.bin", "2.bin"}}) {
    const TempFolder part;
    write_scans(part, names);
    part.write("poses.txt", straight_poses(3));
    expect_error(
        ErrorCode::kCorruptData, [&] { open_dataset(part.path()); }, "poses.txt", "expected 2",
        "found 3");
    part.write("poses.txt", straight_poses(2));
    EXPECT_EQ(open_dataset(part.path())->size(), 2U);
  }
}

TEST(Dataset, TimesMustIncreaseAndBeOneALine) {
  const TempFolder folder;
  write_drive(folder, 3);
  const struct {
    const char *text, *line, *says;
  } cases[] = {
      {"1\n2\n2\n", "times.txt:3:", "after 2.000000000 s, found 2.000000000 s"},
      {"1\n3\n2\n", "times.txt:3:", "after 3.000000000 s"},
      {"1\nnan\n2\n", "times.txt:2:", "finite"},
      {"1\n2 2\n3\n", "times.txt:2:", "one time"},
      {"1\nsoon\n3\n", "times.txt:2:", "\"soon\""},
  };
  for (const auto& bad : cases) {
    folder.write("times.txt", bad.text);
    expect_error(
        ErrorCode::kCorruptData, [&] { open_dataset(folder.path()); }, bad.line, bad.says);
  }
}

TEST(Dataset, ANanPoseIsNamedByFileAndLine) {
  const TempFolder folder;
  write_drive(folder, 3);
  folder.write("poses.txt", straight_poses(2) + "1 0 0 nan 0 1 0 0 0 0 1 0\n");
  expect_error(
      ErrorCode::kCorruptData, [&] { open_dataset(folder.path()); }, "poses.txt:3:", "nan");
}

TEST(Dataset, AFolderThatHoldsNoDriveSaysWhatIsMissing) {
  const TempFolder folder;
  const auto open = [&](const char* poses) {
    open_dataset(folder.path(), {poses, PoseFrame::kAuto, {}});
  };
  expect_error(
      ErrorCode::kNotFound, [&] { open_dataset(folder / "nowhere"); }, "nowhere");
  const auto file = folder.write("file", "");
  expect_error(
      ErrorCode::kNotFound, [&] { open_dataset(file); }, "found a file");
  expect_error(
      ErrorCode::kNotFound, [&] { open(""); }, "velodyne/", "scans/", "found none");
  write_scans(folder, {"velodyne/0.bin"});
  expect_error(
      ErrorCode::kNotFound, [&] { open(""); }, "poses.txt", "no text files");
  folder.write("odom_ndt.txt", straight_poses(1));
  folder.write("poses_gt.txt", straight_poses(1));
  expect_error(
      ErrorCode::kNotFound, [&] { open(""); }, "odom_ndt.txt, poses_gt.txt");
  expect_error(
      ErrorCode::kNotFound, [&] { open("odom.txt"); }, "odom.txt", "odom_ndt.txt");
}

TEST(Dataset, ScansOfTwoKindsOrInTwoPlacesAreRefused) {
  const TempFolder mixed;
  write_scans(mixed, {"scans/0.bin", "scans/1.bin", "scans/2.pcd"});
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_dataset(mixed.path()); }, "2 .bin and 1 .pcd");
  const TempFolder both;
  write_scans(both, {"scans/0.bin", "velodyne/0.bin"});
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_dataset(both.path()); }, "found some in both");
  const TempFolder twice;
  write_scans(twice, {"1.bin", "01.bin"});
  expect_error(
      ErrorCode::kInvalidArgument, [&] { open_dataset(twice.path()); }, "1.bin and", "once");
}

TEST(Dataset, PcdScansNeedAReaderAndAreGivenToIt) {
  const TempFolder folder;
  write_scans(folder, {"0.pcd", "1.pcd"});
  folder.write("poses.txt", straight_poses(2));
  expect_error(
      ErrorCode::kUnsupported, [&] { open_dataset(folder.path()); }, ".pcd", "PCL");
  std::vector<std::string> asked;
  const auto reader = [&](const std::filesystem::path& file) {
    asked.push_back(file.filename());
    PointCloud one;
    one.push_back({1, 2, 3});
    return one;
  };
  const auto source = open_dataset(folder.path(), {"", PoseFrame::kAuto, reader});
  EXPECT_TRUE(asked.empty());
  read_all(*source);
  EXPECT_EQ(asked, (std::vector<std::string>{"0.pcd", "1.pcd"}));
}

TEST(Dataset, ADamagedScanIsReportedWhenItsTurnComesAndCanBePassed) {
  const TempFolder folder;
  write_drive(folder, 3);
  folder.write("velodyne/000001.bin", "0123456789");
  const auto source = open_dataset(folder.path());
  EXPECT_TRUE(source->next());
  for (int attempt = 0; attempt < 2; ++attempt) {
    expect_error(
        ErrorCode::kCorruptData, [&] { source->next(); }, "000001.bin", "found 10");
  }
  source->seek(2);
  EXPECT_EQ(source->next()->index, 2U);
}

TEST(Dataset, AScanThatVanishedIsNotFound) {
  const TempFolder folder;
  write_drive(folder, 2);
  const auto source = open_dataset(folder.path());
  remove(folder / "velodyne/000000.bin");
  expect_error(
      ErrorCode::kNotFound, [&] { source->next(); }, "000000.bin");
}

}  // namespace
}  // namespace cellmap
