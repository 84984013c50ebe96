#include "cellmap/evaluation/trajectory_metrics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <limits>
#include <numbers>
#include <random>
#include <sstream>

#include "support/expect_error.hpp"
#include "support/real_data.hpp"

namespace cellmap {
namespace {

using test::expect_error;

Pose pose_at(double x, double y, double z, double yaw_rad = 0) {
  Pose T = Pose::Identity();
  T.translation() << x, y, z;
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return T;
}

/// Poses `step_m` apart along x, 0 to `length_m`.
std::vector<Pose> straight(int length_m, double step_m = 1) {
  std::vector<Pose> poses;
  for (int i = 0; i <= length_m; ++i) poses.push_back(pose_at(i * step_m, 0, 0));
  return poses;
}

/// A wandering drive and a drifting estimate of it, from a seed.
struct Drive {
  std::vector<Pose> truth, estimate;
};

Drive wandering_drive(unsigned seed, int poses) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal;
  Drive drive{{Pose::Identity()}, {Pose::Identity()}};
  for (int i = 1; i < poses; ++i) {
    Tangent step = Tangent::Zero();
    step << 1.2 + 0.1 * normal(rng), 0, 0, 0, 0, 0.03 * normal(rng);
    Tangent noise;
    for (double& v : noise) v = 0.003 * normal(rng);
    drive.truth.push_back(drive.truth.back() * exp(step));
    drive.estimate.push_back(drive.estimate.back() * exp(step) * exp(noise));
  }
  return drive;
}

/// The KITTI metric again, from its definition, with general matrices and linear searches.
struct SlowKitti {
  int segments = 0;
  double t_percent = 0, r_deg_per_100m = 0;
};

SlowKitti slow_kitti(const std::vector<Pose>& estimate, const std::vector<Pose>& truth) {
  SlowKitti result;
  for (std::size_t first = 0; first < truth.size(); first += 10) {
    for (int length = 100; length <= 800; length += 100) {
      double travelled = 0;
      std::size_t last = first;
      while (last + 1 < truth.size() && travelled <= length) {
        ++last;
        travelled += (truth[last].translation() - truth[last - 1].translation()).norm();
      }
      if (travelled <= length) continue;
      const Eigen::Matrix4d delta = truth[first].matrix().inverse() * truth[last].matrix();
      const Eigen::Matrix4d guess = estimate[first].matrix().inverse() * estimate[last].matrix();
      const Eigen::Matrix4d error = guess.inverse() * delta;
      const double cosine = 0.5 * (error(0, 0) + error(1, 1) + error(2, 2) - 1);
      result.t_percent += 100 * error.block<3, 1>(0, 3).norm() / length;
      result.r_deg_per_100m +=
          100 * 180 / std::numbers::pi / length * std::acos(std::max(std::min(cosine, 1.0), -1.0));
      ++result.segments;
    }
  }
  result.t_percent /= result.segments;
  result.r_deg_per_100m /= result.segments;
  return result;
}

TEST(TrajectoryMetrics, APerfectEstimateHasNoErrorInAnyWorldFrame) {
  const std::vector<Pose> truth = wandering_drive(1, 500).truth;
  std::vector<Pose> moved;
  for (const Pose& pose : truth) moved.push_back(pose_at(100, -20, 3, 2.5) * pose);
  const TrajectoryErrors errors = evaluate_trajectory(moved, truth);
  EXPECT_EQ(errors.poses, 500U);
  EXPECT_GT(errors.segments, 50U);
  for (const double error : {errors.t_rel_percent, errors.r_rel_deg_per_100m, errors.ape_rmse_m,
                             errors.ape_max_m, errors.rpe_rmse_m, errors.rpe_rmse_deg}) {
    EXPECT_LT(error, 1e-9);
  }
}

TEST(TrajectoryMetrics, SegmentsEndAtTheFirstPoseBeyondTheirLength) {
  // 1 m steps: a 100 m segment from pose 0 ends at 101 m.
  EXPECT_EQ(evaluate_trajectory(straight(100), straight(100)).segments, 0U);
  EXPECT_EQ(evaluate_trajectory(straight(101), straight(101)).segments, 1U);
  EXPECT_EQ(evaluate_trajectory(straight(110), straight(110)).segments, 1U);
  EXPECT_EQ(evaluate_trajectory(straight(111), straight(111)).segments, 2U);
  EXPECT_EQ(evaluate_trajectory(straight(201), straight(201)).segments, 11U + 1U);
}

TEST(TrajectoryMetrics, AScaleErrorShowsAsThatPercentage) {
  // One segment of 100 m, measured over 101 m and divided by 100 m.
  const TrajectoryErrors one = evaluate_trajectory(straight(101, 1.02), straight(101));
  EXPECT_NEAR(one.t_rel_percent, 2.02, 1e-9);
  EXPECT_NEAR(one.r_rel_deg_per_100m, 0, 1e-9);
  // 250 m: 15 segments of 100 m (start 0 ... 140) and 5 of 200 m (start 0 ... 40).
  const TrajectoryErrors many = evaluate_trajectory(straight(250, 1.02), straight(250));
  EXPECT_EQ(many.segments, 20U);
  EXPECT_NEAR(many.t_rel_percent, (15 * 2.02 + 5 * 2.0 * 201 / 200) / 20, 1e-9);
}

TEST(TrajectoryMetrics, AYawDriftShowsAsDegreesAHundredMetres) {
  std::vector<Pose> estimate = {Pose::Identity()};
  const double drift_rad = 0.05 * std::numbers::pi / 180;  // a metre
  for (int i = 0; i < 101; ++i) estimate.push_back(estimate.back() * pose_at(1, 0, 0, drift_rad));
  const TrajectoryErrors errors = evaluate_trajectory(estimate, straight(101));
  EXPECT_NEAR(errors.r_rel_deg_per_100m, 5.05, 1e-9);
  EXPECT_NEAR(errors.rpe_rmse_deg, 0.05, 1e-9);
  EXPECT_NEAR(errors.rpe_rmse_m, 0, 1e-9);
}

TEST(TrajectoryMetrics, AgreesWithTheDevkitsDefinition) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    const Drive drive = wandering_drive(seed, 1500);
    const TrajectoryErrors errors = evaluate_trajectory(drive.estimate, drive.truth);
    const SlowKitti expected = slow_kitti(drive.estimate, drive.truth);
    EXPECT_EQ(errors.segments, static_cast<std::size_t>(expected.segments));
    EXPECT_NEAR(errors.t_rel_percent, expected.t_percent, 1e-8);
    EXPECT_NEAR(errors.r_rel_deg_per_100m, expected.r_deg_per_100m, 1e-6);
  }
}

TEST(TrajectoryMetrics, ADriveUnderAHundredMetresHasNoRelativeError) {
  const TrajectoryErrors errors = evaluate_trajectory(straight(50, 1.1), straight(50));
  EXPECT_EQ(errors.segments, 0U);
  EXPECT_TRUE(std::isnan(errors.t_rel_percent));
  EXPECT_TRUE(std::isnan(errors.r_rel_deg_per_100m));
  EXPECT_GT(errors.ape_rmse_m, 0);
  EXPECT_DOUBLE_EQ(errors.length_m, 50);
  EXPECT_NE(to_json(errors).find("\"t_rel_percent\":null"), std::string::npos) << to_json(errors);
  EXPECT_EQ(to_table(errors).find("nan"), std::string::npos) << to_table(errors);
}

TEST(TrajectoryMetrics, ApeIsWhatTheBestRigidMoveLeaves) {
  // Corners of a square, in the estimate bent up and down by turns: no rigid move lessens that.
  const std::vector<Pose> truth = {pose_at(1, 1, 0), pose_at(-1, 1, 0), pose_at(-1, -1, 0),
                                   pose_at(1, -1, 0)};
  std::vector<Pose> estimate = truth;
  for (std::size_t i = 0; i < 4; ++i) estimate[i].translation().z() = i % 2 == 0 ? 0.3 : -0.3;
  for (Pose& pose : estimate) pose = pose_at(5, 6, 7, 1) * pose;
  const TrajectoryErrors errors = evaluate_trajectory(estimate, truth);
  EXPECT_NEAR(errors.ape_rmse_m, 0.3, 1e-9);
  EXPECT_NEAR(errors.ape_max_m, 0.3, 1e-9);
}

TEST(TrajectoryMetrics, ApeOfOneOutlierOnALine) {
  // On a line with 1 m steps the ends pull the fit to the mean: offsets along x of (0, 0, 3)
  // leave (-1, -1, 2) after the best shift.
  const std::vector<Pose> truth = straight(2);
  std::vector<Pose> estimate = truth;
  estimate[2].translation().x() += 3;
  const TrajectoryErrors errors = evaluate_trajectory(estimate, truth);
  EXPECT_NEAR(errors.ape_rmse_m, std::sqrt((1.0 + 1.0 + 4.0) / 3), 1e-9);
  EXPECT_NEAR(errors.ape_max_m, 2, 1e-9);
}

TEST(TrajectoryMetrics, AlignFindsTheMoveBetweenWorlds) {
  const std::vector<Pose> truth = wandering_drive(4, 200).truth;
  Tangent xi;
  xi << 10, -20, 5, 0.3, -0.7, 1.9;
  const Pose T_truth_estimate = exp(xi);
  std::vector<Pose> estimate;
  for (const Pose& pose : truth) estimate.push_back(T_truth_estimate.inverse() * pose);
  EXPECT_LT((align(estimate, truth).matrix() - T_truth_estimate.matrix()).norm(), 1e-9);
}

TEST(TrajectoryMetrics, AlignTurnsButNeverMirrors) {
  std::mt19937 rng(5);
  std::normal_distribution<double> normal;
  std::vector<Pose> truth, mirrored;
  for (int i = 0; i < 20; ++i) {
    truth.push_back(pose_at(3 * normal(rng), 2 * normal(rng), normal(rng)));
    mirrored.push_back(truth.back());
    mirrored.back().translation().x() *= -1;
  }
  EXPECT_TRUE(is_rigid(align(mirrored, truth)));
  EXPECT_GT(evaluate_trajectory(mirrored, truth).ape_rmse_m, 0.1);
  const std::vector<Pose> standing(3, pose_at(1, 2, 3));
  EXPECT_TRUE(is_rigid(align(standing, standing)));
}

TEST(TrajectoryMetrics, RpeIsTheErrorOfSingleSteps) {
  // One step of four is 0.4 m too long; all later ones are right again.
  std::vector<Pose> estimate = straight(4);
  for (std::size_t i = 2; i < estimate.size(); ++i) estimate[i].translation().x() += 0.4;
  EXPECT_NEAR(evaluate_trajectory(estimate, straight(4)).rpe_rmse_m, 0.2, 1e-12);
}

TEST(TrajectoryMetrics, WhatCannotBeComparedIsRefused) {
  expect_error(
      ErrorCode::kInvalidArgument, [] { evaluate_trajectory(straight(4), straight(5)); },
      "found 5 and 6");
  expect_error(
      ErrorCode::kInvalidArgument, [] { evaluate_trajectory(straight(1), straight(1)); },
      "at least 3");
  std::vector<Pose> bad = straight(4);
  bad[3].translation().y() = std::numeric_limits<double>::quiet_NaN();
  expect_error(
      ErrorCode::kInvalidArgument, [&] { evaluate_trajectory(bad, straight(4)); }, "pose 3",
      "estimate");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { align(straight(4), bad); }, "pose 3", "truth");
}

TEST(TrajectoryMetrics, StampedPosesMeetTheTruthAtTheirTimes) {
  const Trajectory truth(
      {{0, pose_at(0, 0, 0)}, {100, pose_at(10, 0, 0)}, {200, pose_at(10, 10, 0)}});
  const Trajectory estimate({{-10, pose_at(-7, 0, 0)},
                             {50, pose_at(5, 0, 0)},
                             {100, pose_at(10, 0, 0)},
                             {190, pose_at(10, 9, 0)},
                             {201, pose_at(99, 0, 0)}});
  const TrajectoryErrors errors = evaluate_trajectory(estimate, truth);
  EXPECT_EQ(errors.poses, 3U);
  EXPECT_NEAR(errors.ape_rmse_m, 0, 1e-9);
  EXPECT_NEAR(errors.length_m, 5 + 9, 1e-9);
  const Trajectory later({{300, pose_at(0, 0, 0)}, {301, pose_at(1, 0, 0)}});
  expect_error(
      ErrorCode::kInvalidArgument, [&] { evaluate_trajectory(later, truth); }, "found 0 of 2");
}

TEST(TrajectoryMetrics, TheJsonHasTheKeysOfTheCommandLine) {
  const TrajectoryErrors errors{300, 357.5, 41, 3.25, 2.5, 1.75, 4.125, 0.005, 0.25};
  EXPECT_EQ(to_json(errors), R"({"poses":300,"length_m":357.5,"segments":41,"t_rel_percent":3.25,)"
                             R"("r_rel_deg_per_100m":2.5,"ape_rmse_m":1.75,"ape_max_m":4.125,)"
                             R"("rpe_rmse_m":0.005,"rpe_rmse_deg":0.25})");
}

/// A row of EVAL.txt: an evaluation of the same files by another program.
struct EvalRow {
  std::string system, sequence, t_percent, r_deg, ape_m;
};

std::vector<EvalRow> read_eval(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::vector<EvalRow> rows;
  for (std::string line; std::getline(in, line);) {
    std::istringstream words(line);
    EvalRow row;
    std::string poses, truth_poses;
    if (words >> row.system >> row.sequence >> poses >> truth_poses >> row.t_percent >> row.r_deg >>
            row.ape_m &&
        row.system != "#") {
      rows.push_back(row);
    }
  }
  return rows;
}

std::string two_decimals(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.2f", value);
  return text;
}

TEST(TrajectoryMetrics, AgreesWithAnIndependentEvaluationOfRealOdometry) {
  const auto folder = test::real_data("kitti-trajectories");
  if (!exists(folder)) GTEST_SKIP() << "no " << folder;
  const std::vector<EvalRow> rows = read_eval(folder / "EVAL.txt");
  ASSERT_GE(rows.size(), 21U);
  for (const EvalRow& row : rows) {
    const Trajectory estimate =
        read_trajectory(folder / "odometry" / row.system / (row.sequence + ".txt"));
    const Trajectory truth = read_trajectory(folder / "ground_truth" / (row.sequence + ".txt"));
    const TrajectoryErrors errors = evaluate_trajectory(estimate, truth);
    EXPECT_EQ(two_decimals(errors.t_rel_percent), row.t_percent) << row.system << row.sequence;
    EXPECT_EQ(two_decimals(errors.r_rel_deg_per_100m), row.r_deg) << row.system << row.sequence;
    EXPECT_EQ(two_decimals(errors.ape_rmse_m), row.ape_m) << row.system << row.sequence;
  }
}

}  // namespace
}  // namespace cellmap
