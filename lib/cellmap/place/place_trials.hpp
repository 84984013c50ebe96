#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "cellmap/place/local_prior.hpp"
#include "cellmap/place/query_points.hpp"
#include "cellmap/place/relocalise.hpp"

namespace cellmap {

/// A place that may be where a query was taken.
struct PlaceToTry {
  CellId cell;
  std::shared_ptr<const RegistrationTarget> target;
  Pose T_map_cell = Pose::Identity();
  Pose T_cell_ground = Pose::Identity();
  double merit = 0;          ///< what places are ordered by: likeness of the signatures
  std::vector<Pose> starts;  ///< T_cell_query to begin from
};

/// The CELLs around a pose in the map, that of the first argument first. Called by one thread at a
/// time.
using AroundProvider = std::function<std::vector<CellAround>(CellId, const Pose& T_map_scan)>;

/// Tries the starts of all places: each on few points, the best on more, the best of those on many,
/// until one is believed. Best first; where the first is not accepted, none is. Deterministic.
std::vector<RelocalisationCandidate> try_places(const std::vector<PlaceToTry>& places,
                                                const QueryPoints& query,
                                                const AroundProvider& around,
                                                const std::optional<PosePrior>& prior,
                                                const RelocaliseOptions& options);

}  // namespace cellmap
