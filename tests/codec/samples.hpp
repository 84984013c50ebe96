#pragma once

#include <random>

#include "cellmap/cell/cell.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

inline Pose random_pose(std::mt19937& rng) {
  std::uniform_real_distribution<double> uniform(-1, 1);
  Tangent xi;
  for (int i = 0; i < 6; ++i) xi[i] = uniform(rng) * (i < 3 ? 1000.0 : 1.5);
  return exp(xi);
}

/// A valid CELL with `planes` random planes on distinct random lattice points.
inline Cell random_cell(std::uint32_t seed, std::uint32_t planes,
                        std::uint32_t lattice_size = 50'000) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  Cell cell;
  cell.lattice.size = lattice_size;
  const Lattice lattice(cell.lattice);
  for (std::uint32_t i = 0; i < lattice_size && cell.indices.size() < planes; ++i) {
    if (rng() % (lattice_size - i) >= planes - cell.indices.size()) continue;
    const Eigen::Vector3d direction = lattice.direction(i);
    Eigen::Vector3d n(uniform(rng), uniform(rng), uniform(rng));
    n = (n.normalized() - 1.2 * direction).normalized();  // faces the origin, at most 57 deg off
    cell.indices.push_back(i);
    cell.planes.push_back({static_cast<float>(60 + 59 * uniform(rng)), static_cast<float>(n.x()),
                           static_cast<float>(n.y()), static_cast<float>(n.z())});
  }
  cell.session = "drive-" + std::to_string(seed);
  cell.sequence = seed + 7;
  cell.T_odom_cell = random_pose(rng);
  cell.first_stamp = 1'600'000'000'123'456'789;
  cell.last_stamp = cell.first_stamp + 600'000'000;
  cell.first_scan = 40;
  cell.scan_count = 7;
  cell.statistics = {.points = 5'000'000'000,
                     .points_in_planes = 4'000'000'001,
                     .patches_hit = 9000,
                     .rejected_few_points = 1,
                     .rejected_gap = 2,
                     .rejected_planarity = 3,
                     .rejected_grazing = 4};
  return cell;
}

inline PosedScan random_scan(std::uint32_t seed, std::size_t points) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<float> uniform(-100, 100);
  PosedScan scan;
  scan.index = 123'456;
  scan.stamp = -5;
  scan.T_odom_sensor = random_pose(rng);
  for (std::size_t i = 0; i < points; ++i) {
    scan.points.push_back({uniform(rng), uniform(rng), uniform(rng)});
  }
  return scan;
}

}  // namespace cellmap
