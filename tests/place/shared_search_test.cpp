#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "cellmap/place/place_search.hpp"
#include "place/random_places.hpp"

// Searches that are split over several searchers and merged.

namespace cellmap {
namespace {

using test::RandomPlaces;
using test::some_views;

/// Each region to one of some searchers.
std::vector<RegionList> split(const RegionList& all, std::size_t shares, std::mt19937& rng) {
  std::vector<RegionList> lists(shares);
  std::uniform_int_distribution<std::size_t> any(0, shares - 1);
  for (const auto* region : all) lists[any(rng)].push_back(region);
  return lists;
}

/// What reaches who merges: descriptions of those alone that may be among the best.
ComparedPlaces sent(ComparedPlaces places, std::size_t count) {
  const auto may = may_be_best(places, count);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!may[i]) places[i].place.reset();
  }
  return places;
}

/// Split over `shares`, merged, as one searcher.
class SplitSearcher : public PlaceSearcher {
 public:
  SplitSearcher(const RandomPlaces& places, std::size_t shares, unsigned seed)
      : searcher_(places.searcher()), shares_(shares), rng_(seed) {}
  ComparedPlaces search(const QueryViews& query, const RegionList& regions,
                        const SearchTerms& terms, const Effort& effort) const override {
    std::vector<ComparedPlaces> found;
    for (const RegionList& share : split(regions, shares_, rng_)) {
      found.push_back(sent(searcher_.search(query, share, terms, effort), terms.count));
    }
    return merged(std::move(found), terms);
  }

 private:
  PartsSearcher searcher_;
  std::size_t shares_;
  mutable std::mt19937 rng_;
};

/// By sorting all of them: the slow twin.
std::vector<CellId> by_definition(const RandomPlaces& places, const QueryViews& query,
                                  std::size_t count) {
  using Rank = std::pair<float, CellId>;
  std::vector<Rank> first, last;
  const bool looks_first = places.places().size() > kCompareAll;
  for (const auto& [id, place] : places.places()) {
    first.push_back({-(looks_first ? first_likeness : likeness)(query, place), id});
  }
  std::sort(first.begin(), first.end());
  first.resize(std::min(first.size(), looks_first ? std::max(count, kShortlist) : count));
  for (const auto& [_, id] : first) last.push_back({-likeness(query, places.places().at(id)), id});
  std::sort(last.begin(), last.end());
  std::vector<CellId> ids;
  for (std::size_t i = 0; i < std::min(count, last.size()); ++i) ids.push_back(last[i].second);
  return ids;
}

void expect_the_same(const std::vector<AlikePlace>& found, const RandomPlaces& places,
                     const std::vector<CellId>& expected) {
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_EQ(found[i].id, expected[i]) << i;
    EXPECT_EQ(to_bytes(found[i].place), to_bytes(places.places().at(expected[i])));
  }
}

TEST(SharedSearch, OverAnySplitTheSamePlacesAreFoundAsInOne) {
  unsigned seed = 0;
  for (const std::uint32_t cells : {300u, 2'000u, 2'700u}) {  // around kCompareAll
    const RandomPlaces places(cells);
    for (const bool ahead : {false, true}) {
      const QueryViews query = some_views(5 + cells, ahead);
      for (const std::size_t count : {1u, 30u, 250u}) {
        const auto expected = by_definition(places, query, count);
        expect_the_same(most_alike(query, places.regions(), places.searcher(), count, 1), places,
                        expected);
        for (const std::size_t shares : {2u, 3u, 9u}) {
          const SplitSearcher searcher(places, shares, ++seed);
          expect_the_same(most_alike(query, places.regions(), searcher, count, 1), places,
                          expected);
        }
      }
    }
  }
}

TEST(SharedSearch, OnlyWhatMayBeAmongTheBestIsDescribed) {
  const RandomPlaces places(kCompareAll + 1);
  const SearchTerms terms{30, true};
  const auto kept = places.searcher().search(some_views(3), places.list(), terms, 1);
  ASSERT_EQ(kept.size(), kShortlist);
  const auto may = may_be_best(kept, terms.count);
  // Any prefix of the places has its 30 best among them.
  for (const std::size_t prefix : {30u, 31u, 200u, 1000u}) {
    std::vector<std::pair<float, CellId>> ranks;
    for (std::size_t i = 0; i < prefix; ++i) ranks.push_back({-kept[i].likeness, kept[i].id});
    std::sort(ranks.begin(), ranks.end());
    ranks.resize(30);
    for (std::size_t i = 0; i < prefix; ++i) {
      const std::pair own(-kept[i].likeness, kept[i].id);
      EXPECT_TRUE(may[i] || !std::ranges::binary_search(ranks, own)) << i;
    }
  }
  EXPECT_LT(std::ranges::count(may, true), 400);
  const auto none = may_be_best(kept, 0);
  EXPECT_EQ(std::ranges::count(none, true), 0);
}

}  // namespace
}  // namespace cellmap
