#include "cellmap/store/sql_writers.hpp"

#include <chrono>
#include <exception>
#include <optional>
#include <tuple>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::chrono::milliseconds kGroupCommitWait(5);
constexpr std::size_t kGroupCommitBatch = 256;
/// What is remembered of how many write to a map at the same time.
constexpr std::size_t kMostIdleLanes = 64;
constexpr int kMostRepetitions = 10;

/// One of several, with a savepoint: one that fails takes back only its own.
void carry_out(SqlConnection& connection, GroupCommit::Write& write) {
  connection.execute("SAVEPOINT write");
  try {
    write.work();
    connection.settle();
  } catch (const TakenBack&) {
    throw;
  } catch (...) {
    write.failure = std::current_exception();
    // After a full disk, for example, the engine has rolled back everything itself.
    if (!connection.in_transaction()) throw;
    connection.execute("ROLLBACK TO write");
  }
  connection.execute("RELEASE write");
}

}  // namespace

SqlWriters::SqlWriters(std::unique_ptr<SqlConnection> first, SqlPool::Open open,
                       std::size_t max_connections, KnownCells* known)
    : can_write_(first != nullptr),
      take_turns_(!open),
      known_(known),
      connections_(open, take_turns_ ? 1 : max_connections, std::move(first)) {}

SqlWriters::Lane::Lane(SqlWriters& writers, Scope scope)
    : commits([this, &writers, scope](const Batch& batch) { writers.execute(*this, scope, batch); },
              kGroupCommitWait, kGroupCommitBatch) {}

SqlWriters::Place::Place(SqlWriters& owner, const Key& key) : writers(owner) {
  const std::lock_guard lock(writers.mutex_);
  lane = &writers.lanes_
              .try_emplace(writers.take_turns_ ? Key{Scope::kAnything, ""} : key, writers,
                           writers.take_turns_ ? Scope::kAnything : key.first)
              .first->second;
  ++lane->users;
}

SqlWriters::Place::~Place() {
  const std::lock_guard lock(writers.mutex_);
  --lane->users;
  if (writers.lanes_.size() <= kMostIdleLanes) return;
  std::erase_if(writers.lanes_, [](const auto& entry) { return entry.second.users == 0; });
}

void SqlWriters::run(const Key& key, const Work& work) {
  const Place place(*this, key);
  place.lane->commits.run([&] { work(*place.lane->connection); });
}

void SqlWriters::roll_back(SqlConnection& connection) noexcept {
  try {
    if (connection.in_transaction()) connection.execute("ROLLBACK");
  } catch (...) {
    // The next BEGIN fails then and says so to its callers.
  }
}

/// One transaction for all.
void SqlWriters::attempt(SqlConnection& connection, Scope scope, const Batch& batch) {
  for (GroupCommit::Write* const write : batch) write->failure = nullptr;
  try {
    if (scope == Scope::kAnything) connection.begin_write();
    if (scope == Scope::kMap) connection.begin_map_write();
    if (scope == Scope::kRows) connection.begin_row_write();
    if (batch.size() == 1) {
      batch.front()->work();
    } else {
      for (GroupCommit::Write* const write : batch) carry_out(connection, *write);
    }
    connection.execute("COMMIT");
  } catch (...) {
    roll_back(connection);
    throw;
  }
}

/// One transaction that locks in order, so that nobody waits for it in a circle.
void SqlWriters::repeat(SqlConnection& connection, Scope scope,
                        GroupCommit::Write& write) noexcept {
  for (int i = 1;; ++i) {
    try {
      return attempt(connection, scope, {&write});
    } catch (const TakenBack&) {
      write.failure = std::current_exception();
      if (i == kMostRepetitions) return;
    } catch (...) {
      write.failure = std::current_exception();
      return;
    }
  }
}

void SqlWriters::execute(Lane& lane, Scope scope, const Batch& batch) noexcept {
  std::optional<KnownCells::Change> change;
  if (known_) change.emplace(*known_);
  try {
    connections_.lend([&](SqlConnection& connection) {
      lane.connection = &connection;
      try {
        attempt(connection, scope, batch);
      } catch (const TakenBack&) {
        for (GroupCommit::Write* const write : batch) repeat(connection, scope, *write);
      }
    });
  } catch (...) {
    for (GroupCommit::Write* const write : batch) {
      if (!write->failure) write->failure = std::current_exception();
    }
  }
}

}  // namespace cellmap
