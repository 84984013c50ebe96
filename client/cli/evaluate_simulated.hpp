#pragma once

#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "cellmap/core/progress.hpp"
#include "client/cli/evaluate_map.hpp"

namespace cellmap::cli {

/// A map of a simulated drive and a second drive that asks where it is.
struct SimulatedTown {
  std::string route = "city";    ///< as SimulatorOptions::route
  double length_m = 0;           ///< of it; 0: all
  std::string lidar = "hdl64e";  ///< of the map
  std::string query_lidar;       ///< of the queries; empty: the same
  std::uint32_t lattice_size = 50'000;
  std::size_t queries = 300;     ///< a scenario
  std::size_t elsewhere = 1000;  ///< queries from places that are not in the map
  std::uint64_t seed = 1;
  int threads = 1;  ///< of the simulator
};

/// Builds the map of the first drive in `store`, where it is not there yet; true poses, three scans
/// a CELL. The whole city takes 1,730 scans, some minutes. Returns its name.
std::string build_simulated(Store& store, const SimulatedTown& town, const std::stop_token& stop,
                            const ProgressCallback& progress);

/// The names of the simulated scenarios, in the order of the report.
std::vector<std::string> simulated_scenarios();

/// Calls `ask` with each query of a scenario, evenly spread over the drive: other cars and new
/// noise in all, headings a few degrees off.
/// - same_lane: the line that was mapped, up to 0.6 m beside it;
/// - other_lane: 3.5 m to the left; opposite_direction: there, the other way round;
/// - occluded: the mapped lane; 120 deg of the view are missing, and of the rest a fifth lies on
///   what the map does not know: half of it stray returns, half people and bushes around the
///   sensor;
/// - leaning: the mapped lane, the sensor leans by up to 10 deg and looks anywhere;
/// - elsewhere: another town of the same kind.
void simulated_queries(const SimulatedTown& town, const std::string& scenario,
                       const std::stop_token& stop,
                       const std::function<void(const KnownQuery&)>& ask);

}  // namespace cellmap::cli
