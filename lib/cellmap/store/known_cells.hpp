#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>

#include "cellmap/store/sql_cells.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

using KnownCell = CellOfMap;  ///< in one state of the store

/// The rows that were read last in one state of the store: the next state forgets all of them.
/// Where one process writes, each of its changes makes a state (`Change`), and an entry is never
/// old; where many do, a state is what the caller says, such as a minute, and an entry is as old.
/// Thread safe.
class KnownCells {
 public:
  /// Around every transaction that writes: what is read meanwhile may be of before or after it, and
  /// is not kept.
  class Change {
   public:
    explicit Change(KnownCells& cells) : cells_(cells) { ++cells_.state_; }
    ~Change() { ++cells_.state_; }
    Change(const Change&) = delete;
    Change& operator=(const Change&) = delete;

   private:
    KnownCells& cells_;
  };

  /// The state of the store, to be asked for before its rows are read; nullopt while it changes.
  std::optional<std::uint64_t> state() const {
    const std::uint64_t state = state_;
    return state % 2 == 0 ? std::optional(state) : std::nullopt;
  }
  /// Null where it is not known in this state.
  std::shared_ptr<const KnownCell> find(std::uint64_t state, const std::string& map, CellId id);
  /// `cell` was read after the store was in this state, which nothing needs to hold any more.
  void insert(std::uint64_t state, const std::string& map, std::shared_ptr<const KnownCell> cell);

 private:
  using OfMap = std::unordered_map<std::uint32_t, std::shared_ptr<const KnownCell>>;
  void forget_all_but(std::uint64_t state);

  static constexpr std::size_t kMaxCells = 10'000;  ///< some 4 MB

  std::atomic<std::uint64_t> state_ = 0;  ///< odd while the store changes
  std::mutex mutex_;                      ///< of all below
  std::uint64_t entries_state_ = 0;       ///< the state in which all entries were read
  std::size_t count_ = 0;
  std::map<std::string, OfMap> entries_;
};

}  // namespace cellmap
