#include <algorithm>
#include <iostream>
#include <nlohmann/json.hpp>
#include <thread>

#include "bench/rows.hpp"
#include "bench/synthetic_places.hpp"
#include "cellmap/place/place_search.hpp"
#include "cellmap/store/descriptions.hpp"
#include "cellmap/store/open_store.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap::bench {
namespace {

/// Parts that are read from a store where the cache has no room for them, as a server does.
class StoredParts : public PlaceParts {
 public:
  StoredParts(Store& store, std::string map, const PlaceRegions& regions, std::size_t budget_bytes)
      : store_(descriptions_of(store)),
        map_(std::move(map)),
        regions_(regions),
        cache_(budget_bytes) {}

  std::shared_ptr<const PlacePart> part(const RegionKey& region) const override {
    if (auto known = cache_.find({1, region})) return known;
    const auto& ids = regions_.find(region)->ids;
    auto part = std::make_shared<PlacePart>();
    part->reserve(ids.size());
    for (const CellDescription& one : store_.descriptions(map_, ids)) {
      part->put(one.cell, described_place_from_bytes(one.bytes).value());
    }
    require_agreement(part->ids() == ids, "the descriptions that were kept");
    cache_.insert({1, region}, part);
    return part;
  }
  bool is_at_hand(const RegionKey& region) const override { return cache_.contains({1, region}); }
  std::size_t bytes() const { return cache_.bytes(); }

 private:
  const Descriptions& store_;
  const std::string map_;
  const PlaceRegions& regions_;
  mutable PartCache cache_;
};

struct Taken {
  double seconds = 0, processor_seconds = 0;
};
Taken taken_by(const std::function<void()>& work) {
  const double begun = now_s(), processor_begun = processor_s();
  work();
  return {now_s() - begun, processor_s() - processor_begun};
}

void keep_all(Store& store, const std::string& map, const SyntheticPlaces& places) {
  std::map<CellId, ContentHash> hashes;
  for (const CellKeeping& one : store.keeping(map)) hashes.emplace(one.id, one.hash);
  for (const auto& region : places.regions().all()) {
    const auto part = places.parts().part(region.key);
    std::vector<CellDescription> descriptions;
    for (const CellId id : region.ids) {
      descriptions.push_back({id, hashes.at(id), to_bytes(*part->find(id))});
    }
    descriptions_of(store).keep_descriptions(map, descriptions);
  }
}

}  // namespace

int keep_places_of_store(const std::string& address, const std::string& map) {
  const auto store = open_store(address);
  keep_all(*store, map, SyntheticPlaces(store->pose_graph(map)));
  return 0;
}

int print_places_of_store(const std::string& address, const std::string& map) {
  constexpr std::size_t kCandidates = 30, kAllBytes = std::size_t{1} << 40;
  const auto store = open_store(address);
  const SyntheticPlaces places(store->pose_graph(map));
  const PlaceRegions& regions = places.regions();
  const DescribedQuery query =
      SyntheticPlaces::query_at(CellId{static_cast<std::uint32_t>(regions.cells() / 3)});
  const int threads = static_cast<int>(std::min(2u, std::thread::hardware_concurrency()));

  nlohmann::json figures{{"cells", regions.cells()}, {"parts", regions.all().size()}};
  const auto add = [&](const std::string& what, const Taken& taken) {
    figures[what] = {{"s", taken.seconds}, {"processor_s", taken.processor_seconds}};
  };
  add("keep", taken_by([&] { keep_all(*store, map, places); }));
  const auto search = [&](const std::string& what, const std::shared_ptr<StoredParts>& parts) {
    std::vector<AlikePlace> found;
    const PartsSearcher searcher(parts);
    add(what, taken_by([&] {
          found = most_alike(query.views(), regions, searcher, kCandidates, threads);
        }));
    require_agreement(found.front().id.value == regions.cells() / 3, "the place itself");
  };
  const auto roomy = std::make_shared<StoredParts>(*store, map, regions, kAllBytes);
  search("first_search", roomy);
  search("search", roomy);
  figures["memory_mib"] = static_cast<double>(roomy->bytes()) / (1 << 20);
  const auto narrow = std::make_shared<StoredParts>(*store, map, regions, roomy->bytes() / 4);
  search("first_search_in_a_quarter", narrow);
  search("search_in_a_quarter", narrow);
  std::cout << figures.dump() << '\n';
  return 0;
}

}  // namespace cellmap::bench
