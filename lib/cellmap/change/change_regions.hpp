#pragma once

#include <vector>

#include "cellmap/change/diff.hpp"

namespace cellmap {

/// A changed patch where it lies.
struct ChangedPatch {
  CellId cell;
  Eigen::Vector3d position;  ///< its middle, map frame
  double area_m2 = 0;
};

/// Groups changed patches of one session: two belong together where they are within `gap_m` of one
/// another, directly or over others. Groups of fewer than `least_patches` are left out; largest
/// area first. O(n log n) for patches that are spread as surfaces are.
std::vector<ChangeRegion> group_changes(const std::vector<ChangedPatch>& patches,
                                        PatchChange change, double gap_m,
                                        std::size_t least_patches);

}  // namespace cellmap
