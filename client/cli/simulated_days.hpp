#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "cellmap/change/diff.hpp"
#include "cellmap/simulation/scene_truth.hpp"

namespace cellmap::cli {

/// Two drives along one route on two days: the same town, other cars, other noise.
struct TwoDays {
  std::string route = "town";    ///< as SimulatorOptions::route
  double length_m = 200;         ///< of it; 0: all
  std::string lidar = "hdl64e";  ///< of both
  std::uint32_t lattice_size = 50'000;
  double lateral_offset_m = 0;  ///< of the second drive
  /// Error of the poses of the second day's CELLs in the map, standard deviation of each axis.
  double pose_error_m = 0.05, pose_error_deg = 0.1;
  std::uint64_t seed = 1;
  int threads = 1;
};

/// The CELLs of one day as they lie in the map, and what was true on that day. The map frame is the
/// world.
struct SimulatedDay {
  SceneTruth truth;
  std::vector<PlacedCell> cells;
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> targets;

  /// The middles of a CELL's patches, world frame.
  std::vector<Eigen::Vector3d> patches_of(CellId cell) const;
  const Pose& T_world_cell(CellId cell) const;  ///< true
};

struct SimulatedDays {
  SimulatedDay earlier, later;  ///< ids differ
  TargetProvider targets() const;
};

/// Drives both. About 10 scans a second and thread.
SimulatedDays simulate_two_days(const TwoDays& days, const std::stop_token& stop,
                                const ProgressCallback& progress);

/// Patches of one kind, counted against the truth.
struct ChangeCount {
  std::size_t patches = 0;     ///< all
  std::size_t never_seen = 0;  ///< of them, by the verdict
  std::size_t claimed = 0;     ///< called changed
  std::size_t right = 0;       ///< of them, on a vehicle where the other day has nothing
  /// Truly changed: on a vehicle where the other day has nothing, and in free sight of a CELL of
  /// the other day that is within reach.
  std::size_t in_sight = 0;
  std::size_t found = 0;  ///< of them, called changed

  void add(const ChangeCount& other);
};

/// By range from the CELL's origin, in steps of 10 m.
struct ChangeScore {
  static constexpr double kStep_m = 10;
  std::vector<ChangeCount> by_range;
  ChangeCount total() const;
};

/// Scores the verdicts on the CELLs of `day`, `diffs`, against the truth of both days.
ChangeScore score_changes(const SimulatedDay& day, const std::vector<CellDiff>& diffs,
                          const SimulatedDay& other, const DiffOptions& options);

}  // namespace cellmap::cli
