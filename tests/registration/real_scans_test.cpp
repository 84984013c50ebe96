#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <numbers>
#include <optional>
#include <random>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/registration/registration.hpp"
#include "support/real_data.hpp"

namespace cellmap {
namespace {

PointCloud read_bin(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  PointCloud cloud;
  for (std::array<float, 4> p; in.read(reinterpret_cast<char*>(p.data()), sizeof p);) {
    cloud.push_back({p[0], p[1], p[2]});
  }
  return cloud;
}

std::vector<Pose> read_poses(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::vector<Pose> poses;
  std::array<double, 12> row;
  while (true) {
    for (double& value : row) {
      if (!(in >> value)) return poses;
    }
    poses.push_back(pose_from_row_major_3x4(row));
  }
}

Scan read_keyframe(const std::filesystem::path& folder, std::size_t k) {
  char name[32];
  std::snprintf(name, sizeof name, "%06zu.bin", k);
  return filter_scan(read_bin(folder / "velodyne" / name), 0, {});
}

/// CELLs of four keyframes of KITTI 00 each, stacked by a real odometry.
class RealScans : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto folder = test::real_data("kitti00-dense");
    if (!exists(folder)) GTEST_SKIP() << "no " << folder;
    odometry_ = read_poses(folder / "odom_ndt.txt");
    truth_ = read_poses(folder / "poses_gt.txt");
    for (const std::size_t first : {0U, 4U, 32U}) {
      std::optional<LocalMap> map;
      for (std::size_t k = first; k < first + 4; ++k) {
        Scan scan = read_keyframe(folder, k);
        if (map) {
          map->add(scan, odometry_[k]);
        } else {
          map.emplace(std::move(scan), odometry_[k], static_cast<std::uint32_t>(k));
        }
      }
      targets_.emplace_back(std::make_shared<const Cell>(build_cell(*map, *lattice_, {})),
                            lattice_);
      base_scans_.push_back(map->base_scan().points);
    }
  }

  std::shared_ptr<const Lattice> lattice_ = std::make_shared<const Lattice>(LatticeSpec{});
  std::vector<Pose> odometry_, truth_;
  std::vector<RegistrationTarget> targets_;
  std::vector<PointCloud> base_scans_;
};

TEST_F(RealScans, NeighboursAgreeWithGroundTruthFromAnyStartAndOtherPlacesAreRefused) {
  for (const RegistrationTarget& target : targets_) {
    EXPECT_GT(target.cell().planes.size(), 7'000U);  // about 8.9k by an earlier prototype
    EXPECT_LT(target.cell().planes.size(), 12'000U);
  }

  const Pose T_a_b = truth_[0].inverse() * truth_[4];
  Tangent error;
  error << 0.25, -0.15, 0.05, 0.005, -0.005, 0.015;
  std::vector<RegistrationResult> results;
  for (const double sign : {1.0, -1.0}) {
    results.push_back(register_cells(targets_[0], base_scans_[0], targets_[1], base_scans_[1],
                                     exp(sign * error) * T_a_b));
    const RegistrationResult& result = results.back();
    EXPECT_TRUE(is_acceptable(result, {}));
    EXPECT_FALSE(result.degeneracy.degenerate);
    // Ground truth itself is good to about 10 cm and 0.4 degrees between neighbours.
    EXPECT_LT((result.T_target_source.translation() - T_a_b.translation()).norm(), 0.2);
    EXPECT_LT(angle_between_rad(result.T_target_source, T_a_b), 0.007);
  }
  EXPECT_LT(
      (results[0].T_target_source.translation() - results[1].T_target_source.translation()).norm(),
      0.01);

  EXPECT_FALSE(is_acceptable(register_scan(targets_[0], base_scans_[2], T_a_b), {}));
  EXPECT_FALSE(is_acceptable(register_scan(targets_[2], base_scans_[0], T_a_b), {}));
}

/// All 6 m CELLs of the 40 keyframes, as the mapper splits them.
class AllNeighbours : public ::testing::Test {
 protected:
  struct Place {
    RegistrationTarget target;
    PointCloud base_scan;
    Pose T_odom_cell;
  };

  void SetUp() override {
    const auto folder = test::real_data("kitti00-dense");
    if (!exists(folder)) GTEST_SKIP() << "no " << folder;
    const std::vector<Pose> odometry = read_poses(folder / "odom_ndt.txt");
    const auto lattice = std::make_shared<const Lattice>(LatticeSpec{});
    std::optional<LocalMap> map;
    const auto finish = [&] {
      auto cell = std::make_shared<const Cell>(build_cell(*map, *lattice, {}));
      places_.push_back({{std::move(cell), lattice}, map->base_scan().points, map->T_odom_cell()});
    };
    for (std::size_t k = 0; k < odometry.size(); ++k) {
      Scan scan = read_keyframe(folder, k);
      if (map && !map->is_complete_for(odometry[k], 6.0)) {
        map->add(scan, odometry[k]);
        continue;
      }
      if (map) finish();
      map.emplace(std::move(scan), odometry[k], static_cast<std::uint32_t>(k));
    }
    finish();
  }

  std::vector<Place> places_;
};

/// 0.3 m and 1 degree off in a direction and about an axis drawn at random, mostly level.
Pose random_start(std::mt19937& random) {
  std::normal_distribution<double> normal;
  const Eigen::Vector3d shift(normal(random), normal(random), 0.2 * normal(random));
  const Eigen::Vector3d turn(0.3 * normal(random), 0.3 * normal(random), normal(random));
  Tangent off;
  off << 0.3 * shift.normalized(), std::numbers::pi / 180 * turn.normalized();
  return exp(off);
}

TEST_F(AllNeighbours, ConvergeToOnePoseFromAnyStart) {
  constexpr int kStarts = 8;
  std::mt19937 random(1);
  std::vector<double> spread_m;  // from the mean of a pair
  for (std::size_t i = 0; i + 1 < places_.size(); ++i) {
    const Place &a = places_[i], &b = places_[i + 1];
    const Pose T_a_b = a.T_odom_cell.inverse() * b.T_odom_cell;
    std::vector<Eigen::Vector3d> ends;
    for (int start = 0; start < kStarts; ++start) {
      const RegistrationResult result = register_cells(a.target, a.base_scan, b.target, b.base_scan,
                                                       random_start(random) * T_a_b);
      EXPECT_TRUE(result.converged) << i;
      ends.push_back(result.T_target_source.translation());
    }
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& end : ends) mean += end / kStarts;
    for (const Eigen::Vector3d& end : ends) spread_m.push_back((end - mean).norm());
  }
  ASSERT_GE(spread_m.size(), 64U);
  std::sort(spread_m.begin(), spread_m.end());
  EXPECT_LT(spread_m[spread_m.size() / 2], 0.5e-3);
  EXPECT_LT(spread_m[spread_m.size() * 95 / 100], 10e-3);
}

}  // namespace
}  // namespace cellmap
