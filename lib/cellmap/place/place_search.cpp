#include "cellmap/place/place_search.hpp"

#include <algorithm>
#include <cassert>
#include <limits>
#include <memory>
#include <mutex>
#include <utility>

#include "cellmap/core/parallel.hpp"

namespace cellmap {
namespace {

using Likeness = float (*)(const DescribedQuery&, const DescribedPlace&);

/// The best first: the most alike, then the lowest id.
struct PlaceRank {
  float minus_likeness = std::numeric_limits<float>::infinity();
  CellId id;
  auto operator<=>(const PlaceRank&) const = default;
};

/// Keeps the best `count` of all that it is offered, by any thread, in any order.
class BestPlaces {
 public:
  explicit BestPlaces(std::size_t count) : count_(count) {}

  void offer(const std::vector<std::pair<PlaceRank, const DescribedPlace*>>& places) {
    const std::lock_guard lock(mutex_);
    for (const auto& [rank, place] : places) {
      if (kept_.size() >= count_ && !(rank < worst_)) continue;
      kept_.push_back({rank, std::make_unique<DescribedPlace>(*place)});
      if (kept_.size() >= 2 * count_) keep_the_best();
    }
  }

  std::vector<AlikePlace> in_order() {
    std::sort(kept_.begin(), kept_.end(), by_rank);
    if (kept_.size() > count_) kept_.resize(count_);
    std::vector<AlikePlace> best;
    best.reserve(kept_.size());
    for (const Kept& one : kept_) best.push_back({one.rank.id, *one.place});
    return best;
  }

 private:
  struct Kept {
    PlaceRank rank;
    std::unique_ptr<DescribedPlace> place;
  };
  static bool by_rank(const Kept& a, const Kept& b) { return a.rank < b.rank; }

  void keep_the_best() {
    const auto last = kept_.begin() + static_cast<std::ptrdiff_t>(count_) - 1;
    std::nth_element(kept_.begin(), last, kept_.end(), by_rank);
    kept_.resize(count_);
    worst_ = kept_.back().rank;
  }

  const std::size_t count_;
  std::mutex mutex_;
  std::vector<Kept> kept_;
  PlaceRank worst_;  // of the first `count_`, once there were twice as many
};

/// Those that are at hand first.
std::vector<const PlaceRegions::Region*> in_order_of_search(const PlaceRegions& regions,
                                                            const PlaceParts& parts) {
  std::vector<const PlaceRegions::Region*> order;
  order.reserve(regions.all().size());
  for (const auto& region : regions.all()) order.push_back(&region);
  // Not of std::ranges, whose result clang 14 cannot compile.
  std::stable_partition(order.begin(), order.end(),
                        [&](const auto* r) { return parts.is_at_hand(r->key); });
  return order;
}

std::vector<AlikePlace> best_of_all(const DescribedQuery& query, const PlaceRegions& regions,
                                    const PlaceParts& parts, std::size_t count, int threads,
                                    Likeness alike) {
  const auto order = in_order_of_search(regions, parts);
  BestPlaces best(count);
  parallel_for(order.size(), 1, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto part = parts.part(order[i]->key);
      std::vector<std::pair<PlaceRank, const DescribedPlace*>> ranked;
      ranked.reserve(order[i]->ids.size());
      for (const CellId id : order[i]->ids) {
        const DescribedPlace* place = part->find(id);
        assert(place);
        ranked.push_back({{-alike(query, *place), id}, place});
      }
      best.offer(ranked);
    }
  });
  return best.in_order();
}

std::vector<AlikePlace> best_of_few(const DescribedQuery& query,
                                    const std::vector<AlikePlace>& places, std::size_t count,
                                    int threads) {
  std::vector<std::pair<PlaceRank, const DescribedPlace*>> ranked(places.size());
  parallel_for(places.size(), 64, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      ranked[i] = {{-likeness(query, places[i].place), places[i].id}, &places[i].place};
    }
  });
  BestPlaces best(count);
  best.offer(ranked);
  return best.in_order();
}

}  // namespace

std::vector<AlikePlace> most_alike(const DescribedQuery& query, const PlaceRegions& regions,
                                   const PlaceParts& parts, std::size_t count, int threads) {
  if (count == 0) return {};
  if (regions.cells() <= kCompareAll) {
    return best_of_all(query, regions, parts, count, threads, likeness);
  }
  const auto some =
      best_of_all(query, regions, parts, std::max(count, kShortlist), threads, first_likeness);
  return best_of_few(query, some, count, threads);
}

}  // namespace cellmap
