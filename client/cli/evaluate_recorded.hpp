#pragma once

#include <filesystem>
#include <functional>
#include <stop_token>
#include <string>
#include <vector>

#include "cellmap/core/progress.hpp"
#include "client/cli/evaluate_map.hpp"

namespace cellmap::cli {

/// A recorded drive as a source of queries: how it becomes a map, and what is an error on it.
struct RecordedDrive {
  std::string name;        ///< of the folder, and of its map and first scenario
  std::string poses;       ///< file of the poses that are taken for the truth
  double cell_distance_m;  ///< above which a new CELL begins
  std::uint32_t lattice_size;
  std::uint32_t min_points;     ///< of a patch
  RelocalisationLimits limits;  ///< what the truth is good for
};

/// The drives that are known and lie under `data`.
std::vector<RecordedDrive> recorded_drives(const std::filesystem::path& data);

/// Builds the map of a drive in `store` where it is not there yet, at the poses that are taken for
/// the truth.
void build_recorded(Store& store, const std::filesystem::path& data, const RecordedDrive& drive,
                    const std::stop_token& stop, const ProgressCallback& progress);

/// Calls `ask` with each query of a drive and the scenario that it belongs to.
///
/// kitti00-keyframes: each keyframe that lies within 4 m of another one more than 50 m of path away
/// is one thinned scan, to be found among the CELLs that are more than 50 m of path away from it;
/// `-608-622` are those that involve keyframes whose truth is doubted; `-absent` are the same
/// queries with every CELL within 50 m of the place left out.
/// Other drives: each scan in the map of the others, the CELL that it is part of left out.
void recorded_queries(const std::filesystem::path& data, const RecordedDrive& drive,
                      const KnownMap& map, const std::stop_token& stop,
                      const std::function<void(const std::string&, const KnownQuery&)>& ask);

}  // namespace cellmap::cli
