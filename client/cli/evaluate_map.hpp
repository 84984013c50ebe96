#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "cellmap/evaluation/relocalisation_metrics.hpp"
#include "cellmap/place/relocalise.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap::cli {

/// A map whose poses are the truth, in memory and ready to be searched.
struct KnownMap {
  std::shared_ptr<const Lattice> lattice;
  PoseGraph graph;
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> targets;
  PlaceIndex index;
  /// CELLs that nobody has seen: of two others each, the front of the first and the back of the
  /// second. They are put together when they are asked for.
  std::map<CellId, std::pair<CellId, CellId>> invented;

  void add(CellId id, std::shared_ptr<const Cell> cell, const Pose& T_map_cell);
  std::shared_ptr<const RegistrationTarget> target(CellId id) const;
  /// Invents CELLs, a long way off, until the map holds `cells`: a city as large as that, of which
  /// most looks like a city but is not where queries come from.
  void grow_to(std::size_t cells, std::uint64_t seed);

 private:
  Cell put_together(const std::pair<CellId, CellId>& parts) const;
};

/// Reads every CELL of a map of a store.
KnownMap load_known_map(const Store& store, const std::string& map);

/// A query whose answer is known.
struct KnownQuery {
  RelocalisationQuery query;
  Pose T_map_query = Pose::Identity();
  bool mapped = true;
  std::vector<CellId> hidden;  ///< CELLs that are left out of the map for this query
};

struct Asked {
  RelocalisationTrial trial;
  std::optional<RelocalisationCandidate> best;  ///< the answer, or the best rejected place
};

/// Asks the map and holds the answer against the truth.
Asked ask(const KnownMap& map, const KnownQuery& query, const RelocaliseOptions& options);

/// The CELLs whose true pose fulfils `condition`.
std::vector<CellId> cells_where(const KnownMap& map,
                                const std::function<bool(CellId, const Pose&)>& condition);

/// Trials by scenario, in the order in which they were run.
struct Scenario {
  std::string name;
  std::vector<RelocalisationTrial> trials;
  RelocalisationLimits limits;
};

}  // namespace cellmap::cli
