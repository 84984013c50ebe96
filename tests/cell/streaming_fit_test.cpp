#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "support/real_data.hpp"

namespace cellmap {
namespace {

/// Local maps of four keyframes of KITTI 00 each, stacked by a real odometry: fewer scans than a
/// CELL usually has, so that most points are judged by a plane that is still young.
class StreamingFitOnRealScans : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto folder = test::real_data("kitti00-dense");
    if (!exists(folder)) GTEST_SKIP() << "no " << folder;
    const auto source =
        open_dataset(folder, {(folder / "odom_ndt.txt").string(), PoseFrame::kSensor, {}});
    while (maps_.size() <= kPairs) {
      const auto raw = source->next();
      ASSERT_TRUE(raw);
      Scan scan = filter_scan(raw->points, raw->stamp, {});
      if (raw->index % 4 == 0) {
        maps_.emplace_back(std::move(scan), raw->T_odom_sensor, 0);
      } else {
        maps_.back().add(scan, raw->T_odom_sensor);
      }
    }
    maps_.pop_back();
    for (const LocalMap& map : maps_) {
      trimmed_.push_back(target_of(map, PlaneFit::kTrimmed));
      streaming_.push_back(target_of(map, PlaneFit::kStreaming));
    }
  }

  RegistrationTarget target_of(const LocalMap& map, PlaneFit fit) const {
    return {std::make_shared<const Cell>(build_cell(map, *lattice_, {.fit = fit})), lattice_};
  }

  static constexpr std::size_t kPairs = 6;
  std::shared_ptr<const Lattice> lattice_ = std::make_shared<const Lattice>(LatticeSpec{});
  std::vector<LocalMap> maps_;
  std::vector<RegistrationTarget> trimmed_, streaming_;
};

/// Rms distance from their plane of the points that lie within 0.2 m of it: the surface, without
/// what stands before and behind it.
double residual_rms_m(const LocalMap& map, const Cell& cell, const Lattice& lattice) {
  constexpr double kSurfaceM = 0.2;
  std::vector<const Plane*> plane_of(lattice.size(), nullptr);
  for (std::size_t k = 0; k < cell.planes.size(); ++k) plane_of[cell.indices[k]] = &cell.planes[k];
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < map.points().size(); ++i) {
    const Eigen::Vector3d p = map.points()[i].cast<double>();
    const std::uint32_t index = lattice.nearest(p);
    if (plane_of[index] == nullptr) continue;
    const Plane& plane = *plane_of[index];
    const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
    const double distance = normal.dot(p - plane.distance_m * lattice.direction(index));
    if (std::abs(distance) > kSurfaceM) continue;
    sum += distance * distance;
    ++count;
  }
  return std::sqrt(sum / count);
}

TEST_F(StreamingFitOnRealScans, ResidualsAreNoLargerAndMostPlanesAreKept) {
  for (std::size_t k = 0; k < maps_.size(); ++k) {
    const Cell &trimmed = trimmed_[k].cell(), &streaming = streaming_[k].cell();
    const double rms_trimmed = residual_rms_m(maps_[k], trimmed, *lattice_);
    const double rms_streaming = residual_rms_m(maps_[k], streaming, *lattice_);
    EXPECT_LT(rms_streaming, 1.05 * rms_trimmed);
    EXPECT_GT(static_cast<double>(streaming.planes.size()),
              0.72 * static_cast<double>(trimmed.planes.size()));
  }
}

TEST_F(StreamingFitOnRealScans, NeighboursAreRegisteredToTheSamePose) {
  for (std::size_t k = 0; k + 1 < maps_.size(); ++k) {
    const Pose T_guess = maps_[k].T_odom_cell().inverse() * maps_[k + 1].T_odom_cell();
    const PointCloud a = every_nth(maps_[k].base_scan().points, 3);
    const PointCloud b = every_nth(maps_[k + 1].base_scan().points, 3);
    const Pose T_trimmed =
        register_cells(trimmed_[k], a, trimmed_[k + 1], b, T_guess).T_target_source;
    const Pose T_streaming =
        register_cells(streaming_[k], a, streaming_[k + 1], b, T_guess).T_target_source;
    EXPECT_LT((T_trimmed.translation() - T_streaming.translation()).norm(), 0.015);
    EXPECT_LT(angle_between_rad(T_trimmed, T_streaming), 1e-3);
  }
}

}  // namespace
}  // namespace cellmap
