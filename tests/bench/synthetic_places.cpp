#include "bench/synthetic_places.hpp"

#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <tuple>

#include "cellmap/core/parallel.hpp"
#include "cellmap/place/place_search.hpp"
#include "cellmap/place/polar_image.hpp"

namespace cellmap::bench {
namespace {

/// In use, of all that was ever asked of the heap.
double heap_mib() {
  const struct mallinfo2 heap = mallinfo2();
  return static_cast<double>(heap.uordblks + heap.hblkhd) / (1 << 20);
}

/// Things that stand around a CELL, in a frame on the ground.
PointCloud things_around(CellId cell) {
  std::mt19937 rng(cell.value);
  std::uniform_real_distribution<float> xy(-70, 70), height(1, 9), extent(-3, 3);
  PointCloud points;
  for (int thing = 0; thing < 40; ++thing) {
    const float x = xy(rng), y = xy(rng), top = height(rng);
    for (int i = 0; i < 6; ++i) points.push_back({x + extent(rng), y + extent(rng), top});
  }
  return points;
}

}  // namespace

PoseGraph street_graph(std::uint32_t cells) {
  constexpr double kSpacingM = 6.44, kStreetsM = 100.0;
  const double side_m = std::sqrt(cells * kSpacingM * kStreetsM / 2);
  const auto along = std::max(1u, static_cast<std::uint32_t>(side_m / kSpacingM));
  const std::uint32_t half = cells / along / 2;
  PoseGraph graph;
  for (std::uint32_t i = 0; i < cells; ++i) {
    const double x = kSpacingM * (i % along);
    const std::uint32_t street = i / along;
    graph.nodes.emplace_hint(graph.nodes.end(), CellId{i + 1},
                             street < half ? upright_pose(x, kStreetsM * street, 0)
                                           : upright_pose(kStreetsM * (street - half), x, 0));
  }
  return graph;
}

namespace {

/// All parts, in a cache that has room for them.
class AllParts : public PlaceParts {
 public:
  explicit AllParts(const PlaceRegions& regions) : cache_(std::numeric_limits<std::size_t>::max()) {
    parallel_for(regions.all().size(), 1, 0, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i)
        cache_.insert({1, regions.all()[i].key}, made(i, regions));
    });
  }
  std::shared_ptr<const PlacePart> part(const RegionKey& region) const override {
    return cache_.find({1, region});
  }
  bool is_at_hand(const RegionKey& region) const override { return cache_.contains({1, region}); }

 private:
  static std::shared_ptr<const PlacePart> made(std::size_t i, const PlaceRegions& regions) {
    auto part = std::make_shared<PlacePart>();
    part->reserve(regions.all()[i].ids.size());
    for (const CellId id : regions.all()[i].ids) {
      part->put(id,
                {CompactSignature(PlaceSignature(Columns(things_around(id)))), Pose::Identity()});
    }
    return part;
  }
  mutable PartCache cache_;
};

}  // namespace

SyntheticPlaces::SyntheticPlaces(PoseGraph graph)
    : graph_(std::move(graph)), regions_(std::make_shared<const PlaceRegions>(graph_)) {
  const double before_mib = heap_mib();
  parts_ = std::make_shared<const AllParts>(*regions_);
  parts_mib_ = heap_mib() - before_mib;
}

DescribedQuery SyntheticPlaces::query_at(CellId cell) {
  Pose T_ground_query = upright_pose(1.0, 0.3, 0.7);
  T_ground_query.translation().z() = kUsualHeightM;
  PointCloud points = things_around(cell);
  for (int i = 0; i < 3000; ++i) {  // ground on all sides
    const auto angle = static_cast<float>(i);
    const float range = 4.0f + 0.005f * angle;
    points.push_back({range * std::cos(angle), range * std::sin(angle), 0});
  }
  return DescribedQuery(transformed(points, T_ground_query.inverse()));
}

WholeIndex::WholeIndex(const SyntheticPlaces& places) {
  const double before_mib = heap_mib();
  signatures_.reserve(places.regions().cells());
  for (const auto& region : places.regions().all()) {
    const auto part = places.parts().part(region.key);
    for (const CellId id : region.ids) {
      slots_.emplace(id, ids_.size());
      ids_.push_back(id);
      signatures_.push_back(part->find(id)->signature.expanded());
    }
  }
  mib_ = heap_mib() - before_mib;
}

std::vector<std::size_t> WholeIndex::slots_near(const PoseGraph& graph, const Pose* T,
                                                double reach_m) const {
  std::vector<std::size_t> slots;
  auto node = graph.nodes.begin();
  for (const auto& [id, slot] : slots_) {
    while (node != graph.nodes.end() && node->first < id) ++node;
    if (node == graph.nodes.end()) break;
    if (node->first != id) continue;
    if (!T || (node->second.translation() - T->translation()).head<2>().norm() <= reach_m) {
      slots.push_back(slot);
    }
  }
  return slots;
}

template <typename Likeness>
std::vector<std::size_t> WholeIndex::best_of(const std::vector<std::size_t>& slots,
                                             std::size_t count, int threads,
                                             const Likeness& likeness) const {
  std::vector<std::tuple<float, CellId, std::size_t>> ranked(slots.size());
  parallel_for(slots.size(), 64, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      ranked[i] = {-likeness(slots[i]), ids_[slots[i]], slots[i]};
    }
  });
  count = std::min(count, ranked.size());
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(count),
                    ranked.end());
  std::vector<std::size_t> best;
  for (std::size_t i = 0; i < count; ++i) best.push_back(std::get<2>(ranked[i]));
  return best;
}

std::vector<CellId> WholeIndex::most_alike(const DescribedQuery& query,
                                           const std::vector<std::size_t>& slots, std::size_t count,
                                           int threads) const {
  constexpr std::size_t kFirstHarmonics = 10, kAll = PlaceSignature::kHarmonics + 1;
  std::vector<std::size_t> some = slots;
  if (slots.size() > kCompareAll) {
    some = best_of(slots, std::max(count, kShortlist), threads, [&](std::size_t slot) {
      return signatures_[slot].most_alike(query.views().some(), kFirstHarmonics);
    });
  }
  std::vector<CellId> best;
  for (const std::size_t slot : best_of(some, count, threads, [&](std::size_t s) {
         return signatures_[s].most_alike(query.views().all(), kAll);
       })) {
    best.push_back(ids_[slot]);
  }
  return best;
}

}  // namespace cellmap::bench
