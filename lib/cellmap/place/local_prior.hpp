#pragma once

#include <vector>

#include "cellmap/place/relocalise.hpp"

namespace cellmap {

/// How far from a CELL's base a scan may be and still be registered to it.
constexpr double kCellReachM = 12.0;
/// How exactly a start must lie within the prior.
constexpr double kStartMarginM = 2.0, kStartMarginRad = 0.105;
/// The steps of the grid of poses that a prior allows.
constexpr double kGridStepM = 2.0, kGridStepRad = 0.0873;

/// A prior in the frame of one CELL.
class LocalPrior {
 public:
  LocalPrior(const PosePrior& prior, const Pose& T_map_cell);

  bool allows(const Pose& T_cell_query, double margin_m, double margin_rad) const;
  /// A grid over all that the prior allows, from its middle outwards, as long as the query would
  /// still be near enough to the CELL.
  std::vector<Pose> grid(const Pose& T_cell_ground, const Pose& T_ground_query) const;

 private:
  PosePrior prior_;
  Pose T_cell_query_;
};

}  // namespace cellmap
