// Writes lib/cellmap/codec/first_probabilities_2.cpp: the probabilities that the models of compact
// planes begin with, from simulated drives alone. What it writes is part of the format: it is kept
// for the record, and to train the tables of a later version.
//
//   ninja train_first_probabilities
//   tests/train_first_probabilities > lib/cellmap/codec/first_probabilities_2.cpp

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <optional>

#include "cellmap/cell/cell_builder.hpp"
#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/simulation/simulator.hpp"

namespace cellmap {
namespace {

constexpr double kBounds[] = {0.005, 0.01, 0.01, 0.02, 0.02, 0.02, 0.03, 0.05};

struct TrainingDrive {
  std::uint64_t seed;
  const char* route;
  double spacing_m;
  double range_noise_m;
  bool is_strict;  ///< only planes of many points without a gap
};
constexpr TrainingDrive kDrives[] = {
    {101, "town", 0.8, 0.02, false}, {102, "city", 1.8, 0.03, false},
    {103, "town", 1.8, 0.05, false}, {104, "city", 0.8, 0.05, true},
    {105, "town", 1.8, 0.03, true},  {106, "city", 1.8, 0.08, false}};
constexpr double kDriveLengthM = 110;

void count(const Cell& cell, BitCounts& counts) {
  CodingLattice lattice(cell.lattice);
  for (const double bound_m : kBounds) {
    count_compact_bits(lattice, cell.indices, cell.planes, bound_m, counts);
  }
}

void count(const TrainingDrive& drive, BitCounts& counts) {
  SimulatorOptions options;
  options.seed = drive.seed;
  options.route = drive.route;
  options.spacing_m = drive.spacing_m;
  options.scans = static_cast<std::size_t>(kDriveLengthM / drive.spacing_m);
  options.lidar.range_noise_m = drive.range_noise_m;
  CellBuildOptions build;
  if (drive.is_strict) {
    build.max_range_gap_m = 0.2;
    build.min_points = 12;
  }
  const auto scans = simulate(options);
  const Lattice lattice(LatticeSpec{});
  std::optional<LocalMap> local_map;
  while (const auto next = scans->next()) {
    Scan scan;
    scan.stamp = next->stamp;
    scan.points = next->points;
    if (local_map && local_map->is_complete_for(next->T_odom_sensor, 6)) {
      count(build_cell(*local_map, lattice, build), counts);
      local_map.reset();
    }
    if (!local_map) {
      local_map.emplace(scan, next->T_odom_sensor, static_cast<std::uint32_t>(next->index));
    } else {
      local_map->add(scan, next->T_odom_sensor);
    }
  }
}

/// In units of 1/256; bits that were seldom seen stay near a half.
int probability(const std::array<std::uint64_t, 2>& counts) {
  const double ones = static_cast<double>(counts[1]) + 2,
               all = ones + static_cast<double>(counts[0]) + 2;
  return std::clamp(static_cast<int>(std::lround(256 * ones / all)), 1, 255);
}

void print(const BitCounts& counts) {
  std::printf(
      "#include \"cellmap/codec/first_probabilities.hpp\"\n\nnamespace cellmap {\n"
      "namespace {\n\n// Written by tests/codec/train_first_probabilities.cpp; part of the "
      "format.\n"
      "// clang-format off\nconstexpr std::uint8_t kCompact[] = {");
  for (std::size_t i = 0; i < counts.size(); ++i) {
    std::printf("%s%d,", i % 24 ? "" : "\n", probability(counts[i]));
  }
  std::printf(
      "\n};\n// clang-format on\n\n}  // namespace\n\n"
      "std::span<const std::uint8_t> first_probabilities_2() { return kCompact; }\n\n"
      "}  // namespace cellmap\n");
}

}  // namespace
}  // namespace cellmap

int main() {
  try {
    cellmap::BitCounts counts;
    for (const auto& drive : cellmap::kDrives) cellmap::count(drive, counts);
    cellmap::print(counts);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "training failed: %s\n", error.what());
    return 1;
  }
}
