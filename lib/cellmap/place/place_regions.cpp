#include "cellmap/place/place_regions.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <span>

#include "cellmap/core/checksum.hpp"

namespace cellmap {
namespace {

std::int32_t region_column(double coordinate_m) {
  constexpr double kLimit = 1e9;  // keeps the conversion defined; no CELL is that far away
  return static_cast<std::int32_t>(
      std::floor(std::clamp(coordinate_m / kRegionSideM, -kLimit, kLimit)));
}

/// On the ground plane, from a place to the nearest point of a region.
double distance_m(const RegionKey& key, const Eigen::Vector2d& place) {
  const Eigen::Vector2d low = kRegionSideM * Eigen::Vector2d(key.x, key.y);
  const Eigen::Vector2d high = low + Eigen::Vector2d::Constant(kRegionSideM);
  return (place - place.cwiseMax(low).cwiseMin(high)).norm();
}

}  // namespace

PlaceRegions::PlaceRegions(const PoseGraph& graph)
    : PlaceRegions(graph, [](CellId) { return true; }) {}

PlaceRegions::PlaceRegions(const PoseGraph& graph, const std::function<bool(CellId)>& holds) {
  std::map<RegionKey, Region> by_key;
  Region* last = nullptr;  // of the CELL before, which is next to most
  for (const auto& [id, pose] : graph.nodes) {
    if (!holds(id)) continue;
    const Eigen::Vector3d position = pose.translation();
    const RegionKey key{region_column(position.x()), region_column(position.y())};
    if (!last || last->key != key) {
      last = &by_key.try_emplace(key, Region{key, {}, {}}).first->second;
    }
    last->ids.push_back(id);
    last->positions.push_back(position);
    ++cells_;
  }
  regions_.reserve(by_key.size());
  for (auto& [key, region] : by_key) regions_.push_back(std::move(region));
}

const PlaceRegions::Region* PlaceRegions::find(const RegionKey& key) const {
  const auto at = std::ranges::lower_bound(regions_, key, {}, &Region::key);
  return at != regions_.end() && at->key == key ? &*at : nullptr;
}

PlaceRegions PlaceRegions::within(const Eigen::Vector2d& centre, double radius_m) const {
  constexpr double kRounding = 1e-6;  // of borders far from the origin
  PlaceRegions near;
  for (const Region& region : regions_) {
    if (distance_m(region.key, centre) > radius_m + kRounding) continue;
    Region some{region.key, {}, {}};
    for (std::size_t i = 0; i < region.ids.size(); ++i) {
      if ((region.positions[i].head<2>() - centre).norm() > radius_m) continue;
      some.ids.push_back(region.ids[i]);
      some.positions.push_back(region.positions[i]);
    }
    if (some.ids.empty()) continue;
    near.cells_ += some.ids.size();
    near.regions_.push_back(std::move(some));
  }
  return near;
}

std::uint64_t checksum_of_cells(const PlaceRegions::Region& region) {
  static_assert(sizeof(CellId) == sizeof(std::uint32_t), "ids lie side by side");
  return checksum(std::as_bytes(std::span(region.ids)));
}

}  // namespace cellmap
