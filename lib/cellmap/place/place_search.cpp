#include "cellmap/place/place_search.hpp"

#include <algorithm>
#include <cassert>
#include <iterator>
#include <limits>
#include <mutex>
#include <queue>

#include "cellmap/core/parallel.hpp"

namespace cellmap {
namespace {

using Likeness = float (*)(const QueryViews&, const DescribedPlace&);

/// The best first: the most alike, then the lowest id.
struct PlaceRank {
  float minus_likeness = std::numeric_limits<float>::infinity();
  CellId id;
  auto operator<=>(const PlaceRank&) const = default;
};

PlaceRank first_rank(const ComparedPlace& place) { return {-place.first, place.id}; }
PlaceRank last_rank(const ComparedPlace& place) { return {-place.likeness, place.id}; }

void sort_by_first_look(ComparedPlaces& places) {
  std::sort(places.begin(), places.end(), [](const ComparedPlace& a, const ComparedPlace& b) {
    return first_rank(a) < first_rank(b);
  });
}

/// Keeps the best `count` of all that it is offered, by any thread, in any order.
class BestPlaces {
 public:
  explicit BestPlaces(std::size_t count) : count_(count) {}

  void offer(const std::vector<std::pair<PlaceRank, const DescribedPlace*>>& places) {
    const std::lock_guard lock(mutex_);
    for (const auto& [rank, place] : places) {
      if (kept_.size() >= count_ && !(rank < worst_)) continue;
      const float likeness = -rank.minus_likeness;
      kept_.push_back({rank.id, likeness, likeness, std::make_unique<DescribedPlace>(*place)});
      if (kept_.size() >= 2 * count_) keep_the_best();
    }
  }

  ComparedPlaces in_order() {
    sort_by_first_look(kept_);
    if (kept_.size() > count_) kept_.resize(count_);
    return std::move(kept_);
  }

 private:
  void keep_the_best() {
    const auto last = kept_.begin() + static_cast<std::ptrdiff_t>(count_) - 1;
    std::nth_element(kept_.begin(), last, kept_.end(),
                     [](const ComparedPlace& a, const ComparedPlace& b) {
                       return first_rank(a) < first_rank(b);
                     });
    kept_.resize(count_);
    worst_ = first_rank(kept_.back());
  }

  const std::size_t count_;
  std::mutex mutex_;
  ComparedPlaces kept_;
  PlaceRank worst_;  // of the first `count_`, once there were twice as many
};

ComparedPlaces best_of(const QueryViews& query, const RegionList& regions, const PlaceParts& parts,
                       std::size_t count, const Effort& effort, Likeness alike) {
  BestPlaces best(count);
  parallel_for(regions.size(), 1, effort, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto part = parts.part(regions[i]->key);
      std::vector<std::pair<PlaceRank, const DescribedPlace*>> ranked;
      ranked.reserve(regions[i]->ids.size());
      for (const CellId id : regions[i]->ids) {
        const DescribedPlace* place = part->find(id);
        assert(place);
        ranked.push_back({{-alike(query, *place), id}, place});
        effort.give_way();
      }
      best.offer(ranked);
    }
  });
  return best.in_order();
}

}  // namespace

std::size_t SearchTerms::kept() const { return first_look ? std::max(count, kShortlist) : count; }

std::vector<bool> may_be_best(const ComparedPlaces& places, std::size_t count) {
  std::vector<bool> may(places.size(), false);
  std::priority_queue<PlaceRank> best;  // of those so far, the worst on top
  for (std::size_t i = 0; i < places.size() && count > 0; ++i) {
    const PlaceRank rank = last_rank(places[i]);
    if (best.size() == count && !(rank < best.top())) continue;
    may[i] = true;
    if (best.size() == count) best.pop();
    best.push(rank);
  }
  return may;
}

ComparedPlaces merged(std::vector<ComparedPlaces> found, const SearchTerms& terms) {
  ComparedPlaces all;
  for (ComparedPlaces& some : found) std::move(some.begin(), some.end(), std::back_inserter(all));
  sort_by_first_look(all);
  if (all.size() > terms.kept()) all.resize(terms.kept());
  return all;
}

ComparedPlaces PartsSearcher::search(const QueryViews& query, const RegionList& regions,
                                     const SearchTerms& terms, const Effort& effort) const {
  if (terms.count == 0) return {};
  RegionList order = regions;
  // Not of std::ranges, whose result clang 14 cannot compile.
  std::stable_partition(order.begin(), order.end(),
                        [&](const auto* region) { return parts_->is_at_hand(region->key); });
  ComparedPlaces places = best_of(query, order, *parts_, terms.kept(), effort,
                                  terms.first_look ? first_likeness : likeness);
  if (!terms.first_look) return places;
  parallel_for(places.size(), 64, effort, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      places[i].likeness = likeness(query, *places[i].place);
    }
  });
  return places;
}

std::vector<AlikePlace> most_alike(const QueryViews& query, const PlaceRegions& regions,
                                   const PlaceSearcher& searcher, std::size_t count,
                                   const Effort& effort) {
  RegionList all;
  all.reserve(regions.all().size());
  for (const PlaceRegions::Region& region : regions.all()) all.push_back(&region);
  const SearchTerms terms{count, regions.cells() > kCompareAll};
  ComparedPlaces places = searcher.search(query, all, terms, effort);
  std::sort(places.begin(), places.end(), [](const ComparedPlace& a, const ComparedPlace& b) {
    return last_rank(a) < last_rank(b);
  });
  if (places.size() > count) places.resize(count);
  std::vector<AlikePlace> best;
  best.reserve(places.size());
  for (const ComparedPlace& one : places) {
    assert(one.place);
    best.push_back({one.id, *one.place});
  }
  return best;
}

}  // namespace cellmap
