#include "cellmap/place/part_cache.hpp"

#include <limits>

namespace cellmap {

std::uint64_t PartCache::new_index() {
  const std::lock_guard lock(mutex_);
  return next_index_++;
}

std::shared_ptr<const PlacePart> PartCache::find(const Key& key) {
  const std::lock_guard lock(mutex_);
  const auto found = by_key_.find(key);
  if (found == by_key_.end()) return nullptr;
  entries_.splice(entries_.begin(), entries_, found->second);
  return found->second->second;
}

bool PartCache::contains(const Key& key) const {
  const std::lock_guard lock(mutex_);
  return by_key_.contains(key);
}

void PartCache::insert(const Key& key, std::shared_ptr<const PlacePart> part) {
  const std::lock_guard lock(mutex_);
  if (const auto earlier = by_key_.find(key); earlier != by_key_.end()) erase(earlier);
  bytes_ += part->bytes();
  entries_.emplace_front(key, std::move(part));
  by_key_[key] = entries_.begin();
  while (bytes_ > budget_bytes_ && entries_.size() > 1) erase(by_key_.find(entries_.back().first));
}

void PartCache::erase_index(std::uint64_t index) {
  constexpr std::int32_t kFirst = std::numeric_limits<std::int32_t>::min();
  const std::lock_guard lock(mutex_);
  auto at = by_key_.lower_bound(Key{index, {kFirst, kFirst}});
  while (at != by_key_.end() && at->first.index == index) erase(at++);
}

std::size_t PartCache::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

void PartCache::erase(std::map<Key, std::list<Entry>::iterator>::iterator at) {
  bytes_ -= at->second->second->bytes();
  entries_.erase(at->second);
  by_key_.erase(at);
}

}  // namespace cellmap
