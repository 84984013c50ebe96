#pragma once

#include <memory>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/place/described_place.hpp"
#include "cellmap/place/place_regions.hpp"

namespace cellmap {

/// A part of the index of places: some described CELLs, by id. 1.2 kB a CELL.
class PlacePart {
 public:
  void reserve(std::size_t cells);  ///< makes room for as many in all, and for no more
  /// Replaces an earlier one of the same id. Quick in order of id.
  void put(CellId id, const DescribedPlace& place);
  void remove(CellId id);
  /// nullptr where it is not there.
  const DescribedPlace* find(CellId id) const;

  const std::vector<CellId>& ids() const { return ids_; }  ///< ascending
  std::size_t size() const { return ids_.size(); }
  std::size_t bytes() const {
    return places_.capacity() * (sizeof(CellId) + sizeof(DescribedPlace));
  }

 private:
  std::vector<CellId> ids_;
  std::vector<DescribedPlace> places_;  // of each
};

/// Where the parts of an index come from. Thread safe; must not start threads of its own, because
/// searches ask from theirs.
class PlaceParts {
 public:
  virtual ~PlaceParts() = default;
  /// A part that has at least the CELLs of a region. Never null.
  virtual std::shared_ptr<const PlacePart> part(const RegionKey& region) const = 0;
  /// Whether `part` would take no time. Those are searched first, before others take their room.
  virtual bool is_at_hand(const RegionKey& region) const = 0;
};

}  // namespace cellmap
