#pragma once

#include "cellmap/place/described_query.hpp"
#include "cellmap/place/relocalise.hpp"

namespace cellmap {

/// The points of a query as the trials need them. The ground is much the same everywhere: of the
/// few points that search, half stand higher than half a metre above it.
struct QueryPoints {
  PointCloud screen, search, refine;
  ScanView scored;  ///< evenly taken of all
  UprightSurfaces surfaces;
  Pose T_ground_query;
  /// Less than half of the surroundings was seen: no place is certain before all were tried.
  bool is_narrow;

  QueryPoints(const RelocalisationQuery& query, const DescribedQuery& described,
              const RelocaliseOptions& options);
};

}  // namespace cellmap
