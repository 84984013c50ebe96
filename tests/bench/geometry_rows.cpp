#include <benchmark/benchmark.h>

#include <cmath>
#include <optional>

#include "bench/instruction_sets.hpp"
#include "bench/rows.hpp"
#include "cellmap/cell/build_cell.hpp"
#include "cellmap/cell/cell_builder.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/simulation/random.hpp"

namespace cellmap::bench {
namespace {

constexpr double kPaperSegmentationMs = 11.0, kPaperExtractionMs = 49.0;

PointCloud uniform_directions(std::size_t count) {
  simulation::Random random(1);
  PointCloud cloud;
  while (cloud.size() < count) {
    const Eigen::Vector3d p(random.normal(), random.normal(), random.normal());
    cloud.push_back((20.0 * p.normalized()).cast<float>());
  }
  return cloud;
}

/// The tree decides in float: where it differs, both lattice points must be equally near but for
/// float's last digits.
void check_indices(const Setting& setting, const PointCloud& cloud,
                   const std::vector<std::uint32_t>& ours,
                   const std::vector<std::uint32_t>& baseline) {
  std::size_t different = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (ours[i] == baseline[i]) continue;
    ++different;
    const Eigen::Vector3d unit = cloud[i].cast<double>().normalized();
    const double chord_ours = (setting.lattice->direction(ours[i]) - unit).norm();
    const double chord_baseline = (setting.lattice->direction(baseline[i]) - unit).norm();
    require_agreement(std::abs(chord_ours - chord_baseline) < 1e-6,
                      "the same nearest lattice point for every point but float ties");
  }
  require_agreement(different < 1 + cloud.size() / 500, "few float ties of the KD-tree");
}

void nearest_row(const Setting& setting, const std::string& data, const PointCloud& cloud,
                 const AddRow& add) {
  std::vector<std::uint32_t> ours(cloud.size()), baseline(cloud.size());
  const Contestant our_way{[&] {
    setting.lattice->nearest(cloud, ours);
    benchmark::DoNotOptimize(ours.data());
  }};
  const Contestant paper_way{[&] {
    setting.tree->nearest(cloud, baseline, 1);
    benchmark::DoNotOptimize(baseline.data());
  }};
  on_instruction_sets(true, [&] {
    const Comparison comparison = compare(our_way, paper_way, setting.effort(3, 1));
    check_indices(setting, cloud, ours, baseline);
    add(duration_row("nearest_lattice_point", 1, "ns/point",
                     1e-9 * static_cast<double>(cloud.size()), comparison, data));
  });
}

/// Without the tests that ours has and the paper has not, the two keep the same patches.
void check_planes(const Setting& setting, const CellPair& pair) {
  CellBuildOptions options;
  options.fit = PlaneFit::kRansac;
  options.max_thickness_ratio = 1.0;
  options.min_grazing_angle_deg = 1e-3;
  options.range_margin_m = 1e3;
  const double ours =
      static_cast<double>(build_cell(pair.local_map_a, *setting.lattice, options).planes.size());
  const double baseline = static_cast<double>(
      build_cell_paper_way(pair.local_map_a.points(), *setting.tree, 1).valid());
  require_agreement(std::abs(ours - baseline) < 0.03 * baseline,
                    "the same number of planes within 3 % (" + std::to_string(ours) + " and " +
                        std::to_string(baseline) + ")");
}

/// A scan of a local map with its odometry pose, as it came.
PosedScan scan_of(const LocalMap& map, std::size_t k) {
  const Pose& T_cell_scan = map.scans()[k].T_cell_scan;
  PointCloud points;
  for (std::size_t i = k == 0 ? 0 : map.scan_ends()[k - 1]; i < map.scan_ends()[k]; ++i) {
    points.push_back(map.points()[i]);
  }
  PosedScan scan;
  scan.points = transformed(points, T_cell_scan.inverse());
  scan.T_odom_sensor = map.T_odom_cell() * T_cell_scan;
  return scan;
}

/// What is left to do when the last scan of a CELL comes: ours has taken in the others.
void last_scan_row(const Setting& setting, const CellPair& pair, PlaneFit fit, const AddRow& add) {
  const std::size_t scans = pair.local_map_a.scans().size();
  const PosedScan last = scan_of(pair.local_map_a, scans - 1);
  std::vector<PosedScan> before;
  for (std::size_t k = 1; k + 1 < scans; ++k) before.push_back(scan_of(pair.local_map_a, k));
  const CellBuildOptions options{.fit = fit};
  std::optional<LocalMap> map;
  std::optional<CellBuilder> builder;
  const Contestant ours{[&] {
                          map->add({.points = last.points}, last.T_odom_sensor);
                          benchmark::DoNotOptimize(builder->finish(*map));
                        },
                        [&] {
                          map.emplace(pair.local_map_a.base_scan(), pair.local_map_a.T_odom_cell(),
                                      0);
                          builder.emplace(*setting.lattice, options);
                          for (const PosedScan& scan : before) {
                            map->add({.points = scan.points}, scan.T_odom_sensor);
                            builder->update(*map);
                          }
                        }};
  const Contestant baseline{[&] {
    benchmark::DoNotOptimize(
        build_cell_paper_way(pair.local_map_a.points(), *setting.tree, options.threads));
  }};
  add(duration_row("cell_generation", 1, "ms", 1e-3, compare(ours, baseline, setting.effort(6, 1)),
                   pair.data + ", " + to_string(fit) + ", after the last scan"));
}

}  // namespace

void require_agreement(bool holds, const std::string& what) {
  if (!holds) throw Error(ErrorCode::kInternal, "ours and the baseline must have " + what);
}

void nearest_rows(const Setting& setting, const AddRow& add) {
  for (const CellPair& pair : setting.pairs) {
    nearest_row(setting, pair.data, pair.scan_a(), add);
  }
  nearest_row(setting, "uniform directions", uniform_directions(120'000), add);
}

void cell_rows(const Setting& setting, const AddRow& add) {
  for (const CellPair& pair : setting.pairs) {
    check_planes(setting, pair);
    for (const int threads : setting.threads) {
      CellBuildOptions options;
      options.threads = threads;
      const Contestant ours{[&] {
        benchmark::DoNotOptimize(build_cell(pair.local_map_a, *setting.lattice, options));
      }};
      const Contestant baseline{[&] {
        benchmark::DoNotOptimize(
            build_cell_paper_way(pair.local_map_a.points(), *setting.tree, threads));
      }};
      Row row = duration_row("cell_generation", threads, "ms", 1e-3,
                             compare(ours, baseline, setting.effort(6, threads)), pair.data);
      row.extra["points"] = pair.local_map_a.points().size();
      row.extra["paper_ms"] = kPaperSegmentationMs + kPaperExtractionMs;
      add(std::move(row));
    }
    for (const PlaneFit fit : {PlaneFit::kTrimmed, PlaneFit::kStreaming}) {
      last_scan_row(setting, pair, fit, add);
    }
  }
}

}  // namespace cellmap::bench
