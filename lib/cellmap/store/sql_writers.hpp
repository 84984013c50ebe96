#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "cellmap/store/group_commit.hpp"
#include "cellmap/store/known_cells.hpp"
#include "cellmap/store/sql_pool.hpp"

namespace cellmap {

/// Carries out changes in transactions. Changes of one map that come at the same time share one,
/// those of several maps go over several connections at once, where the engine has them. Order of
/// locks: `SqlConnection`. Thread safe.
class SqlWriters {
 public:
  /// May be called again after a failed transaction, so it must not change anything but what it
  /// sets anew. Begins by locking what it writes to.
  using Work = std::function<void(SqlConnection&)>;

  /// `first`: a connection; null: nothing can be written. `open`: how to get up to
  /// `max_connections` of them; null: `first` is the only one, and all changes take turns. `known`:
  /// told of every change; null where others change the store too.
  SqlWriters(std::unique_ptr<SqlConnection> first, SqlPool::Open open, std::size_t max_connections,
             KnownCells* known);

  bool can_write() const { return can_write_; }

  // Each returns once the change is durable, or throws why it did not come to be. A change that is
  // taken back because of another transaction (`TakenBack`) is carried out again, some times.

  /// Excludes all others that write.
  void change_anything(const Work& work) { run({Scope::kAnything, ""}, work); }
  /// Changes one map; `work` locks its row.
  void change_map(const std::string& map, const Work& work) { run({Scope::kMap, map}, work); }
  /// Changes rows of jobs.
  void change_rows(const Work& work) { run({Scope::kRows, ""}, work); }

  static void roll_back(SqlConnection& connection) noexcept;

 private:
  enum class Scope { kAnything, kMap, kRows };
  using Key = std::pair<Scope, std::string>;
  using Batch = std::vector<GroupCommit::Write*>;
  /// Those whose changes share transactions.
  struct Lane {
    Lane(SqlWriters& writers, Scope scope);
    GroupCommit commits;
    SqlConnection* connection = nullptr;  ///< of the batch that is carried out
    std::size_t users = 0;
  };
  /// A lane for as long as somebody uses it.
  struct Place {
    Place(SqlWriters& owner, const Key& key);
    ~Place();
    SqlWriters& writers;
    Lane* lane;
  };

  void run(const Key& key, const Work& work);
  void execute(Lane& lane, Scope scope, const Batch& batch) noexcept;
  static void attempt(SqlConnection& connection, Scope scope, const Batch& batch);
  static void repeat(SqlConnection& connection, Scope scope, GroupCommit::Write& write) noexcept;

  const bool can_write_, take_turns_;
  KnownCells* const known_;
  SqlPool connections_;
  std::mutex mutex_;  ///< of the lanes
  std::map<Key, Lane> lanes_;
};

}  // namespace cellmap
