#pragma once

#include <map>
#include <memory>
#include <random>
#include <vector>

#include "cellmap/place/place_search.hpp"
#include "place/seen_towns.hpp"

namespace cellmap::test {

/// Places that look like nothing, in regions of 20; every tenth looks like another one, so that
/// there are ties. Parts of them are at hand.
class RandomPlaces : public PlaceParts {
 public:
  explicit RandomPlaces(std::uint32_t cells, unsigned seed = 1) {
    std::mt19937 rng(seed);
    PoseGraph graph;
    for (std::uint32_t i = 1; i <= cells; ++i) {
      const CellId id{i};
      const bool is_twin = i > 10 && i % 10 == 0;
      places_.emplace(id, is_twin ? places_.at({i - 10}) : random_place(rng));
      graph.nodes[id] = upright_pose(kRegionSideM * (i * 7919 % ((cells + 19) / 20)), 1, 0);
    }
    regions_ = PlaceRegions(graph);
  }

  const PlaceRegions& regions() const { return regions_; }
  const std::map<CellId, DescribedPlace>& places() const { return places_; }
  RegionList list() const {
    RegionList all;
    for (const auto& region : regions_.all()) all.push_back(&region);
    return all;
  }
  PartsSearcher searcher() const { return PartsSearcher({std::shared_ptr<void>(), this}); }

  std::shared_ptr<const PlacePart> part(const RegionKey& key) const override {
    auto part = std::make_shared<PlacePart>();
    for (const CellId id : regions_.find(key)->ids) part->put(id, places_.at(id));
    return part;
  }
  bool is_at_hand(const RegionKey&) const override { return true; }

 private:
  static DescribedPlace random_place(std::mt19937& rng) {
    std::uniform_int_distribution<int> step(-127, 127), energy(1, 255);
    CompactSignature::Steps steps;
    for (auto& c : steps.cosine) c = static_cast<std::int8_t>(step(rng));
    for (auto& s : steps.sine) s = static_cast<std::int8_t>(step(rng));
    for (auto& e : steps.energy) e = static_cast<std::uint8_t>(energy(rng));
    return {CompactSignature(steps), upright_pose(0.01 * step(rng), 0, 0)};
  }

  std::map<CellId, DescribedPlace> places_;
  PlaceRegions regions_;
};

/// A query from among upright things; `ahead`: it sees nothing else.
inline QueryViews some_views(unsigned seed, bool ahead = false) {
  const PointCloud all = seen(town(seed), sensor_at(1, 0, 0.3));
  PointCloud points;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!ahead || all.x[i] > std::abs(all.y[i])) points.push_back(all[i]);
  }
  return DescribedQuery(points).views();
}

}  // namespace cellmap::test
