#include "cellmap/scan/trajectory.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "cellmap/scan/text_table.hpp"
#include "support/expect_error.hpp"
#include "support/real_data.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using test::expect_error;

/// Turned left by `yaw_rad` at (x, y, z).
Pose pose_at(double x, double y, double z, double yaw_rad = 0) {
  Pose T = Pose::Identity();
  T.translation() << x, y, z;
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return T;
}

Trajectory quarter_turn() {
  return Trajectory({{1'000'000'001, pose_at(0, 0, 0)},
                     {1'500'000'000, pose_at(3, 4, 0)},
                     {2'500'000'000, pose_at(3, 4, 12, std::numbers::pi / 2)}});
}

TEST(Trajectory, RefusesTimesThatDoNotIncrease) {
  for (const Stamp second : {0, 5}) {
    expect_error(
        ErrorCode::kInvalidArgument,
        [&] {
          Trajectory({{5, pose_at(0, 0, 0)}, {second, pose_at(1, 0, 0)}});
        },
        "pose 1");
  }
}

TEST(Trajectory, RefusesPosesThatAreNotRigid) {
  Pose scaled = Pose::Identity();
  scaled.linear() *= 1.01;
  const Pose nan = pose_at(0, std::numeric_limits<double>::quiet_NaN(), 0);
  for (const Pose& bad : {scaled, nan}) {
    expect_error(
        ErrorCode::kInvalidArgument,
        [&] {
          Trajectory({{0, Pose::Identity()}, {1, bad}});
        },
        "pose 1", "rigid");
  }
}

TEST(Trajectory, GivesThePoseItselfAtItsStamp) {
  const Trajectory trajectory = quarter_turn();
  for (const StampedPose& pose : trajectory.poses()) {
    ASSERT_TRUE(trajectory.at(pose.stamp));
    EXPECT_EQ(trajectory.at(pose.stamp)->matrix(), pose.pose.matrix());
  }
}

TEST(Trajectory, InterpolatesBetweenNeighbours) {
  const Trajectory trajectory({{0, pose_at(0, 0, 0)},
                               {400, pose_at(3, 4, 0)},
                               {800, pose_at(3, 4, 12, std::numbers::pi / 2)}});
  EXPECT_LT((trajectory.at(100)->matrix() - pose_at(0.75, 1, 0).matrix()).norm(), 1e-12);
  // A pure turn with a climb along its axis is a screw: both parts are linear in time.
  const Pose quarter = pose_at(3, 4, 3, std::numbers::pi / 8);
  EXPECT_LT((trajectory.at(500)->matrix() - quarter.matrix()).norm(), 1e-12);
}

TEST(Trajectory, NeverExtrapolates) {
  EXPECT_FALSE(quarter_turn().at(1'000'000'000));
  EXPECT_FALSE(quarter_turn().at(2'500'000'001));
  EXPECT_FALSE(Trajectory().at(0));
}

TEST(Trajectory, LengthIsTheSumOfTheSteps) {
  EXPECT_DOUBLE_EQ(quarter_turn().length_m(), 5 + 12);
  EXPECT_EQ(Trajectory().length_m(), 0);
}

TEST(TrajectoryFiles, KittiTextReadsBackTheSame) {
  const test::TempFolder folder;
  const Trajectory written = quarter_turn();
  write_trajectory(folder / "poses.txt", written, TrajectoryFormat::kKitti);
  const std::vector<Stamp> stamps = {1'000'000'001, 1'500'000'000, 2'500'000'000};
  const Trajectory read = read_trajectory(folder / "poses.txt", stamps);
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read[i].stamp, written[i].stamp);
    EXPECT_EQ(read[i].pose.translation(), written[i].pose.translation());
    EXPECT_LT((read[i].pose.matrix() - written[i].pose.matrix()).norm(), 1e-15);
  }
}

TEST(TrajectoryFiles, TumTextReadsBackTheSameToTheNanosecond) {
  const test::TempFolder folder;
  const Trajectory written({{-1'500'000'001, pose_at(0, 0, 0)},
                            {-1, pose_at(0, 0.1, 0)},
                            {1'577'836'980'099'104'601, pose_at(1.0 / 3, 2, 3, 1)},
                            {1'577'836'980'099'104'602, pose_at(1, 2, 3, -3)}});
  write_trajectory(folder / "poses.tum", written, TrajectoryFormat::kTum);
  const Trajectory read = read_trajectory(folder / "poses.tum");
  ASSERT_EQ(read.size(), written.size());
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_EQ(read[i].stamp, written[i].stamp);
    EXPECT_LT((read[i].pose.matrix() - written[i].pose.matrix()).norm(), 1e-15);
  }
}

TEST(TrajectoryFiles, KittiRowsAreRowMajorAndTenthsOfASecondApart) {
  const test::TempFolder folder;
  const auto file = folder.write("poses.txt",
                                 "# a comment\r\n"
                                 "1 0 0 0 0 1 0 0 0 0 1 0\r\n"
                                 "\n"
                                 "0 -1 0 1e0  1 0 0 +2.5  0 0 1 -3");
  const Trajectory trajectory = read_kitti_trajectory(file);
  ASSERT_EQ(trajectory.size(), 2U);
  EXPECT_EQ(trajectory[1].stamp, 100'000'000);
  EXPECT_LT(
      (trajectory[1].pose.matrix() - pose_at(1, 2.5, -3, std::numbers::pi / 2).matrix()).norm(),
      1e-12);
}

TEST(TrajectoryFiles, TumRowsAreStampTranslationQuaternionWithWLast) {
  const test::TempFolder folder;
  const auto file = folder.write("t.txt",
                                 "# stamp tx ty tz qx qy qz qw\n"
                                 "1567410201.7452047 1 2 3 0 0 1 0\n");
  const Trajectory trajectory = read_trajectory(file);
  ASSERT_EQ(trajectory.size(), 1U);
  EXPECT_EQ(trajectory[0].stamp, 1'567'410'201'745'204'700);
  EXPECT_LT((trajectory[0].pose.matrix() - pose_at(1, 2, 3, std::numbers::pi).matrix()).norm(),
            1e-12);
}

TEST(TrajectoryFiles, EveryMalformedRowIsNamedByFileAndLine) {
  const std::string good = "1 0 0 0 0 1 0 0 0 0 1 0\n";
  const std::string tum = "1 0 0 0 0 0 0 1\n";
  const struct {
    std::string text, line, says;
  } cases[] = {
      {good + "1 0 0 0 0 1 0 0 0 0 1\n", ":2:", "12 numbers, found 11"},
      {good + "#\n1 0 0 0 0 1 0 0 0 0 1 0 7\n", ":3:", "12 numbers, found 13"},
      {good + "1 0 0 nan 0 1 0 0 0 0 1 0\n", ":2:", "finite number, found \"nan\""},
      {good + "1 0 0 -inf 0 1 0 0 0 0 1 0\n", ":2:", "finite number"},
      {good + "1 0 0 0x1 0 1 0 0 0 0 1 0\n", ":2:", "expected a number, found \"0x1\""},
      {good + "1 0 0 1e999 0 1 0 0 0 0 1 0\n", ":2:", "1e999"},
      {good + "2 0 0 0 0 2 0 0 0 0 2 0\n", ":2:", "rotation"},
      {good + "1 0 0 0 0 1 0 0 0 0 -1 0\n", ":2:", "rotation"},
      {good + tum, ":2:", "KITTI row of 12 numbers, found 8"},
      {tum + good, ":2:", "TUM row of 8 numbers, found 12"},
      {tum + tum, ":2:", "time after 1.000000000 s, found 1.000000000 s"},
      {"1 0 0 0 0 0 0 2\n", ":1:", "quaternion"},
      {"1567410201745204700 0 0 0 0 0 0 1\n", ":1:", "nanoseconds?"},
      {"frame x y z\n", ":1:", "12 numbers or a TUM row of 8, found 4"},
      {"\n# nothing\n", "p.txt:", "found none"},
      {"", "p.txt:", "found none"},
  };
  const test::TempFolder folder;
  for (const auto& bad : cases) {
    const auto file = folder.write("p.txt", bad.text);
    expect_error(
        ErrorCode::kCorruptData, [&] { read_trajectory(file); }, bad.line, bad.says, file.string());
  }
}

TEST(TrajectoryFiles, AsManyPosesAsTimesAreDemanded) {
  const test::TempFolder folder;
  const auto file = folder.write("p.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  const std::vector<Stamp> stamps = {1, 2};
  expect_error(
      ErrorCode::kCorruptData, [&] { read_kitti_trajectory(file, stamps); }, "expected 2 poses",
      "found 1");
}

TEST(TrajectoryFiles, AFileThatIsNotThereOrNoFileIsSaidSo) {
  const test::TempFolder folder;
  expect_error(
      ErrorCode::kNotFound, [&] { read_trajectory(folder / "no.txt"); }, "no.txt");
  expect_error(
      ErrorCode::kIo, [&] { read_trajectory(folder.path()); }, "regular file");
  expect_error(
      ErrorCode::kIo, [&] { read_trajectory("/dev/zero"); }, "regular file");
  expect_error(
      ErrorCode::kIo,
      [&] { write_trajectory(folder / "no/p.txt", quarter_turn(), TrajectoryFormat::kTum); },
      "p.txt", "cannot be written");
}

TEST(TrajectoryFiles, BinaryRubbishIsRefusedWithoutEchoingIt) {
  const test::TempFolder folder;
  const auto file = folder.write("p.txt", "1\x1b[31m 0 0 0 0 1 0 0 0 0 1 0\n");
  expect_error(
      ErrorCode::kCorruptData, [&] { read_trajectory(file); }, "\"1?[31m\"");
}

TEST(TrajectoryFiles, SecondsTextIsExact) {
  EXPECT_EQ(seconds_text(0), "0.000000000");
  EXPECT_EQ(seconds_text(-1), "-0.000000001");
  EXPECT_EQ(seconds_text(1'567'410'201'745'204'701), "1567410201.745204701");
  EXPECT_EQ(seconds_text(std::numeric_limits<Stamp>::min()), "-9223372036.854775808");
}

TEST(TrajectoryFiles, KittiGroundTruthHasItsKnownLength) {
  const auto file = test::real_data("kitti-trajectories/ground_truth/00.txt");
  if (!exists(file)) GTEST_SKIP() << "no " << file;
  const Trajectory truth = read_trajectory(file);
  EXPECT_EQ(truth.size(), 4541U);
  EXPECT_NEAR(truth.length_m(), 3724, 5);  // the length the KITTI literature gives for sequence 00
}

}  // namespace
}  // namespace cellmap
