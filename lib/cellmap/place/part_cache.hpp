#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "cellmap/place/place_part.hpp"

namespace cellmap {

/// The parts of indices of places that were used last, of any number of maps, within a budget of
/// memory. Who has been handed a part keeps it as long as it likes, beyond the budget. Thread safe.
class PartCache {
 public:
  struct Key {
    std::uint64_t index = 0;  ///< which index: `new_index`
    RegionKey region;
    auto operator<=>(const Key&) const = default;
  };

  explicit PartCache(std::size_t budget_bytes) : budget_bytes_(budget_bytes) {}

  /// A number that no other index has.
  std::uint64_t new_index();

  /// nullptr where it is not there; else it counts as used.
  std::shared_ptr<const PlacePart> find(const Key& key);
  bool contains(const Key& key) const;
  /// Replaces an earlier one. The longest unused ones make room, but this one stays whatever its
  /// size.
  void insert(const Key& key, std::shared_ptr<const PlacePart> part);
  void erase_index(std::uint64_t index);

  std::size_t bytes() const;  ///< of the parts that are kept

 private:
  using Entry = std::pair<Key, std::shared_ptr<const PlacePart>>;
  void erase(std::map<Key, std::list<Entry>::iterator>::iterator at);

  const std::size_t budget_bytes_;
  mutable std::mutex mutex_;
  std::uint64_t next_index_ = 1;
  std::size_t bytes_ = 0;
  std::list<Entry> entries_;  // most recent first
  std::map<Key, std::list<Entry>::iterator> by_key_;
};

}  // namespace cellmap
