#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "cellmap/place/described_query.hpp"
#include "cellmap/place/part_cache.hpp"
#include "cellmap/place/place_search.hpp"

namespace cellmap::bench {

/// CELLs every 6.44 m along a grid of streets 100 m apart, as in a city.
PoseGraph street_graph(std::uint32_t cells);

/// A map of any size that no LiDAR ever saw: each CELL is described by things scattered at random
/// around it.
class SyntheticPlaces {
 public:
  explicit SyntheticPlaces(PoseGraph graph);

  const PoseGraph& graph() const { return graph_; }
  const PlaceRegions& regions() const { return *regions_; }
  const PlaceParts& parts() const { return *parts_; }
  PartsSearcher searcher() const { return PartsSearcher(parts_); }
  double parts_mib() const { return parts_mib_; }  ///< that they take of the heap

  /// As from a metre beside a CELL, turned.
  static DescribedQuery query_at(CellId cell);

 private:
  PoseGraph graph_;
  std::shared_ptr<const PlaceRegions> regions_;
  std::shared_ptr<const PlaceParts> parts_;
  double parts_mib_ = 0;
};

/// How it was done before: one array of whole signatures of 4.4 kB, found by a tree of CELLs.
class WholeIndex {
 public:
  /// The same descriptions.
  explicit WholeIndex(const SyntheticPlaces& places);
  double mib() const { return mib_; }

  /// The CELLs near a place, or all.
  std::vector<std::size_t> slots_near(const PoseGraph& graph, const Pose* T, double reach_m) const;
  std::vector<CellId> most_alike(const DescribedQuery& query, const std::vector<std::size_t>& slots,
                                 std::size_t count, int threads) const;

 private:
  template <typename Likeness>
  std::vector<std::size_t> best_of(const std::vector<std::size_t>& slots, std::size_t count,
                                   int threads, const Likeness& likeness) const;

  std::map<CellId, std::size_t> slots_;
  std::vector<CellId> ids_;
  std::vector<PlaceSignature> signatures_;
  double mib_ = 0;
};

}  // namespace cellmap::bench
