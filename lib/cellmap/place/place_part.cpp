#include "cellmap/place/place_part.hpp"

#include <algorithm>

namespace cellmap {

void PlacePart::reserve(std::size_t cells) {
  ids_.reserve(cells);
  places_.reserve(cells);
}

void PlacePart::put(CellId id, const DescribedPlace& place) {
  const auto at = std::ranges::lower_bound(ids_, id);
  const auto slot = at - ids_.begin();
  if (at != ids_.end() && *at == id) {
    places_[static_cast<std::size_t>(slot)] = place;
    return;
  }
  ids_.insert(at, id);
  places_.insert(places_.begin() + slot, place);
}

void PlacePart::remove(CellId id) {
  const auto at = std::ranges::lower_bound(ids_, id);
  if (at == ids_.end() || *at != id) return;
  places_.erase(places_.begin() + (at - ids_.begin()));
  ids_.erase(at);
}

const DescribedPlace* PlacePart::find(CellId id) const {
  const auto at = std::ranges::lower_bound(ids_, id);
  if (at == ids_.end() || *at != id) return nullptr;
  return &places_[static_cast<std::size_t>(at - ids_.begin())];
}

}  // namespace cellmap
