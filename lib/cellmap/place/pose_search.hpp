#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// How a pose is searched from several starting poses: on few points first, then on many.
struct PoseSearchOptions {
  std::size_t search_points = 3'000;   ///< of the scan, for each starting pose; about 4 ms each
  std::size_t refine_points = 30'000;  ///< of the scan, for the answer
  RegistrationOptions registration;    ///< of the answer

  void validate() const;
};

/// Orders poses by how well scan and CELL agree there; at most 1.
double agreement(const RegistrationScores& scores);

/// Registers few points from each start; the results, best agreement first. Starts that end at the
/// same pose are reported once.
std::vector<RegistrationResult> search_poses(const RegistrationTarget& target,
                                             const PointCloud& scan, std::span<const Pose> starts,
                                             const PoseSearchOptions& options);

/// Registers up to `refine_points` from one start.
RegistrationResult refine_pose(const RegistrationTarget& target, const PointCloud& scan,
                               const Pose& start, const PoseSearchOptions& options);

/// About `count` points of the scan, evenly taken.
PointCloud thinned(const PointCloud& scan, std::size_t count);

}  // namespace cellmap
