#include "server/api/place_parts.hpp"

#include <algorithm>
#include <cassert>
#include <iterator>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/descriptions.hpp"
#include "cellmap/store/read_cell.hpp"

namespace cellmap::server {

DescribedCells::DescribedCells(Store& store, PartCache& cache, std::string map,
                               std::shared_ptr<const Lattice> lattice, OnUnkept on_unkept)
    : store_(store),
      cache_(cache),
      map_(std::move(map)),
      lattice_(std::move(lattice)),
      on_unkept_(std::move(on_unkept)),
      index_(cache.new_index()) {}

DescribedCells::~DescribedCells() { cache_.erase_index(index_); }

bool DescribedCells::is_at_hand(const RegionKey& region) const {
  return cache_.contains({index_, region});
}

std::shared_ptr<const PlacePart> DescribedCells::part(const PlaceRegions::Region& region) {
  if (auto known = known_part(region)) return known;
  // The parts of neighbouring regions can be made at the same time.
  const auto turn = static_cast<std::uint32_t>(region.key.x + 4 * region.key.y) % turns_.size();
  const std::lock_guard lock(turns_[turn]);
  if (auto known = known_part(region)) return known;
  auto made = made_part(region);
  cache_.insert({index_, region.key}, made);
  return made;
}

std::shared_ptr<const PlacePart> DescribedCells::known_part(const PlaceRegions::Region& region) {
  auto known = cache_.find({index_, region.key});
  return known && std::ranges::includes(known->ids(), region.ids) ? known : nullptr;
}

std::shared_ptr<const PlacePart> DescribedCells::made_part(
    const PlaceRegions::Region& region) const {
  auto earlier = cache_.find({index_, region.key});
  // Other graphs may have other CELLs here (those of sessions that are not aligned): they stay too,
  // as long as what moved away or left the map does not outgrow what is here.
  if (earlier && earlier->size() > 2 * region.ids.size()) earlier.reset();
  std::vector<CellId> ids;
  std::ranges::set_union(region.ids, earlier ? earlier->ids() : std::vector<CellId>(),
                         std::back_inserter(ids));
  auto part = std::make_shared<PlacePart>();
  part->reserve(ids.size());
  std::vector<CellId> unknown;
  for (const CellId id : ids) {
    const DescribedPlace* described = earlier ? earlier->find(id) : nullptr;
    described ? part->put(id, *described) : unknown.push_back(id);
  }
  read_or_make(std::move(unknown), *part);
  return part;
}

void DescribedCells::read_or_make(std::vector<CellId> ids, PlacePart& part) const {
  if (ids.empty()) return;
  Descriptions& kept = descriptions_of(store_);
  for (const CellDescription& one : kept.descriptions(map_, ids)) {
    if (const auto place = described_place_from_bytes(one.bytes)) part.put(one.cell, *place);
  }
  std::erase_if(ids, [&](CellId id) { return part.find(id) != nullptr; });
  std::vector<CellDescription> made;
  for (const CellId id : ids) {
    const StoredCell stored = store_.stored_cell(map_, id);
    const DescribedPlace place = describe_place(reconstruct_points(cell_of(stored), *lattice_));
    part.put(id, place);
    made.push_back({id, stored.hash, to_bytes(place)});
  }
  if (made.empty()) return;
  try {
    kept.keep_descriptions(map_, made);
  } catch (const Error& error) {
    // They are made again the next time, and the query has its answer.
    if (on_unkept_) on_unkept_(map_, error);
  }
}

std::shared_ptr<const PlacePart> PartsOfGraph::part(const RegionKey& region) const {
  const PlaceRegions::Region* cells = regions_->find(region);
  assert(cells);
  return cells_->part(*cells);
}

}  // namespace cellmap::server
