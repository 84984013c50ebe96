#include "cellmap/store/known_cells.hpp"

#include <utility>

namespace cellmap {

std::shared_ptr<const KnownCell> KnownCells::find(std::uint64_t state, const std::string& map,
                                                  CellId id) {
  const std::lock_guard lock(mutex_);
  if (state != entries_state_) return nullptr;
  const auto of_map = entries_.find(map);
  if (of_map == entries_.end()) return nullptr;
  const auto found = of_map->second.find(id.value);
  return found == of_map->second.end() ? nullptr : found->second;
}

void KnownCells::insert(std::uint64_t state, const std::string& map,
                        std::shared_ptr<const KnownCell> cell) {
  const std::lock_guard lock(mutex_);
  if (state < entries_state_) return;  // who read it was overtaken by a change
  if (state > entries_state_ || count_ >= kMaxCells) forget_all_but(state);
  const std::uint32_t id = cell->record.id.value;
  if (entries_[map].emplace(id, std::move(cell)).second) ++count_;
}

void KnownCells::forget_all_but(std::uint64_t state) {
  entries_.clear();
  count_ = 0;
  entries_state_ = state;
}

}  // namespace cellmap
