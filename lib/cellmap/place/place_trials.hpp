#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "cellmap/place/relocalise.hpp"
#include "cellmap/place/signature_index.hpp"

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

/// How far from a CELL's base a scan may be and still be registered to it.
constexpr double kCellReachM = 12.0;
/// How exactly a start must lie within the prior.
constexpr double kStartMarginM = 2.0, kStartMarginRad = 0.105;

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
