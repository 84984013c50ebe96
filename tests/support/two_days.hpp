#pragma once

#include <string>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "support/box_scene.hpp"

namespace cellmap::test {

/// A car beside the lane of `street`, 1.5 m high: here on one day and gone on another.
inline const BoxScene::Box kParkedCar{{8, 2.6, -1.7}, {12.2, 4.4, -0.2}};

inline BoxScene street_with(const std::vector<BoxScene::Box>& things) {
  BoxScene scene = street();
  for (const auto& [min, max] : things) scene.add(min, max);
  return scene;
}

/// What a LiDAR with 2 cm of noise sees of a scene, as a CELL.
inline Cell cell_seen(const BoxScene& scene, const Pose& T_world_cell, const Lattice& lattice,
                      unsigned seed) {
  BoxScene::Sensor sensor;
  sensor.noise_m = 0.02;
  sensor.seed = seed;
  const LocalMap local_map(filter_scan(scene.scan(T_world_cell, sensor), 0, {}), T_world_cell, 0);
  return build_cell(local_map, lattice, {});
}

/// Inside of a box grown by `margin_m`.
inline bool is_on(const BoxScene::Box& box, const Eigen::Vector3d& p, double margin_m) {
  return ((p - box.min).array() > -margin_m).all() && ((box.max - p).array() > -margin_m).all();
}

}  // namespace cellmap::test
