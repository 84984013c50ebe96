#pragma once

#include <memory>
#include <utility>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/registration/registration.hpp"
#include "support/box_scene.hpp"

namespace cellmap::test {

/// A CELL of three scans of the scene, two metres apart, starting at `T_world_cell`.
inline RegistrationTarget target_at(const BoxScene& scene, const Pose& T_world_cell,
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

}  // namespace cellmap::test
