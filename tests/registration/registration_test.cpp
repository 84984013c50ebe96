#include "cellmap/registration/registration.hpp"

#include <gtest/gtest.h>

#include "cellmap/cell/build_cell.hpp"
#include "support/box_scene.hpp"

namespace cellmap {
namespace {

using test::BoxScene;
using test::level_pose;

/// A CELL of three scans, two metres apart, starting at `T_world_cell`.
RegistrationTarget target_at(const BoxScene& scene, const Pose& T_world_cell,
                             const BoxScene::Sensor& sensor = {}) {
  const auto lattice = std::make_shared<const Lattice>(LatticeSpec{});
  LocalMap local_map(Scan{.points = scene.scan(T_world_cell, sensor)}, T_world_cell, 0);
  for (const double ahead : {2.0, 4.0}) {
    const Pose T_world_scan = T_world_cell * level_pose(ahead, 0, 0);
    local_map.add(Scan{.points = scene.scan(T_world_scan, sensor)}, T_world_scan);
  }
  Cell cell = build_cell(local_map, *lattice, {});
  cell.session = "test";
  validate(cell);
  return {std::make_shared<const Cell>(std::move(cell)), lattice};
}

double translation_error_m(const Pose& estimate, const Pose& truth) {
  return (estimate.translation() - truth.translation()).norm();
}

TEST(RegisterScan, FindsAKnownPoseToTheMillimetre) {
  const BoxScene scene = test::street();
  const RegistrationTarget target = target_at(scene, level_pose(0, 0, 0));
  const Pose truth = level_pose(6.0, 0.4, 3.0);
  const PointCloud scan = scene.scan(truth);
  Tangent error;
  error << 0.2, -0.2, 0.1, 0.005, -0.005, 0.015;

  const RegistrationResult result = register_scan(target, scan, exp(error) * truth);

  EXPECT_TRUE(result.converged);
  EXPECT_LT(translation_error_m(result.T_target_source, truth), 1e-3);
  EXPECT_LT(angle_between_rad(result.T_target_source, truth), 1e-4);
}

}  // namespace
}  // namespace cellmap
