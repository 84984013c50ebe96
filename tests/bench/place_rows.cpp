#include <benchmark/benchmark.h>

#include <cmath>

#include "bench/rows.hpp"
#include "bench/synthetic_places.hpp"
#include "cellmap/place/place_search.hpp"

namespace cellmap::bench {
namespace {

constexpr std::size_t kCandidates = 30;  // as relocalisation has them

std::vector<CellId> ids_of(const std::vector<AlikePlace>& places) {
  std::vector<CellId> ids;
  for (const AlikePlace& place : places) ids.push_back(place.id);
  return ids;
}

/// Searches that begin with which CELLs to consider, one in parts and one in the whole.
struct PlaceSearches {
  const SyntheticPlaces& places;
  const WholeIndex& whole;
  const DescribedQuery& query;
  const Pose* near = nullptr;  ///< nullptr: anywhere
  double reach_m = 0;
  int threads = 1;

  std::vector<CellId> in_parts() const {
    const auto search = [&](const PlaceRegions& regions) {
      return ids_of(most_alike(query.views(), regions, places.searcher(), kCandidates, threads));
    };
    if (!near) return search(places.regions());
    return search(places.regions().within(near->translation().head<2>(), reach_m));
  }
  std::vector<CellId> in_the_whole() const {
    return whole.most_alike(query, whole.slots_near(places.graph(), near, reach_m), kCandidates,
                            threads);
  }
};

void add_place_row(const std::string& name, const PlaceSearches& searches, CellId right,
                   const Setting& setting, const AddRow& add) {
  const std::vector<CellId> found = searches.in_parts();
  require_agreement(found == searches.in_the_whole(), "the same places in parts and in the whole");
  require_agreement(!found.empty() && found.front() == right, "the place itself as the best");
  const std::size_t cells = searches.places.regions().cells();
  const Comparison comparison =
      compare(Contestant{[&] { benchmark::DoNotOptimize(searches.in_parts()); }},
              Contestant{[&] { benchmark::DoNotOptimize(searches.in_the_whole()); }},
              {.seconds = setting.quick ? 3.0 : 40.0, .min_pairs = 5, .threads = searches.threads});
  Row row = duration_row(name, searches.threads, "ms", 1e-3, comparison,
                         std::to_string(cells) + " synthetic places");
  row.extra["memory_mib"] = searches.places.parts_mib();
  row.extra["baseline_memory_mib"] = searches.whole.mib();
  row.extra["note"] = "what is known of the places takes " +
                      std::to_string(std::lround(searches.places.parts_mib())) + " MiB in " +
                      std::to_string(searches.places.regions().all().size()) + " parts, before " +
                      std::to_string(std::lround(searches.whole.mib()));
  add(std::move(row));
}

}  // namespace

void place_rows(const Setting& setting, const AddRow& add) {
  for (const std::uint32_t cells :
       {setting.quick ? 10'000u : 100'000u, setting.quick ? 100'000u : 1'000'000u}) {
    const SyntheticPlaces places(street_graph(cells));
    const WholeIndex whole(places);
    const CellId right{cells / 3};
    const DescribedQuery query = SyntheticPlaces::query_at(right);
    for (const int threads : setting.threads) {
      add_place_row("place_search", {places, whole, query, nullptr, 0, threads}, right, setting,
                    add);
    }
    const Pose& T = places.graph().nodes.at(right);
    add_place_row("place_search_within_50_m", {places, whole, query, &T, 50.0, 1}, right, setting,
                  add);
  }
}

}  // namespace cellmap::bench
