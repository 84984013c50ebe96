#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/geometry/lattice.hpp"
#include "cellmap/place/part_cache.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap::server {

/// Is told that what was described of a map's CELLs could not be kept, for a full disk, say.
using OnUnkept = std::function<void(const std::string& map, const Error& why)>;

/// The descriptors of the CELLs of a map, read from the store when a query first needs their
/// region; those that it has not yet are made of the CELLs and kept there. They are forgotten when
/// the cache needs their room. A CELL's descriptor depends on its bytes alone, so one object serves
/// every revision: where CELLs came or moved into a region, its part is made anew of those that are
/// described already and the others. Parts never change, so whoever reads one is not disturbed.
/// Thread safe.
class DescribedCells {
 public:
  /// `store` and `cache` outlive it.
  DescribedCells(Store& store, PartCache& cache, std::string map,
                 std::shared_ptr<const Lattice> lattice, OnUnkept on_unkept = {});
  ~DescribedCells();
  DescribedCells(const DescribedCells&) = delete;
  DescribedCells& operator=(const DescribedCells&) = delete;

  /// A part that has at least the CELLs of a region: 5 us for each that is new to it, and 2 ms
  /// where the store has no descriptor of it. Throws as the store and the codec do.
  std::shared_ptr<const PlacePart> part(const PlaceRegions::Region& region);
  bool is_at_hand(const RegionKey& region) const;

 private:
  std::shared_ptr<const PlacePart> known_part(const PlaceRegions::Region& region);
  std::shared_ptr<const PlacePart> made_part(const PlaceRegions::Region& region) const;
  void read_or_make(std::vector<CellId> ids, PlacePart& part) const;

  Store& store_;
  PartCache& cache_;
  const std::string map_;
  const std::shared_ptr<const Lattice> lattice_;
  const OnUnkept on_unkept_;
  const std::uint64_t index_;
  /// Who makes a part holds one, so that no part is made twice at a time.
  std::array<std::mutex, 16> turns_;
};

/// They, where the CELLs of one pose graph lie.
class PartsOfGraph : public PlaceParts {
 public:
  PartsOfGraph(std::shared_ptr<DescribedCells> cells, std::shared_ptr<const PlaceRegions> regions)
      : cells_(std::move(cells)), regions_(std::move(regions)) {}

  std::shared_ptr<const PlacePart> part(const RegionKey& region) const override;
  bool is_at_hand(const RegionKey& region) const override { return cells_->is_at_hand(region); }

 private:
  std::shared_ptr<DescribedCells> cells_;
  std::shared_ptr<const PlaceRegions> regions_;
};

}  // namespace cellmap::server
