#include "cellmap/store/sql_pool.hpp"

namespace cellmap {

SqlPool::Snapshot::Snapshot(SqlConnection& reader) : connection(reader) { connection.begin_read(); }

SqlPool::Snapshot::~Snapshot() {
  // ROLLBACK of a transaction that only read cannot fail in a way that matters; an error that the
  // reader saw has been thrown already.
  try {
    if (connection.in_transaction()) connection.execute("ROLLBACK");
  } catch (const Error&) {
  }
}

std::unique_ptr<SqlConnection> SqlPool::take() {
  std::unique_lock lock(mutex_);
  returned_.wait(lock, [&] { return !free_.empty() || opened_ < max_connections_; });
  if (!free_.empty()) {
    std::unique_ptr<SqlConnection> connection = std::move(free_.back());
    free_.pop_back();
    return connection;
  }
  ++opened_;
  lock.unlock();
  try {
    return open_();
  } catch (...) {
    lock.lock();
    --opened_;
    returned_.notify_one();
    throw;
  }
}

void SqlPool::give_back(std::unique_ptr<SqlConnection> connection) {
  const std::lock_guard lock(mutex_);
  free_.push_back(std::move(connection));
  returned_.notify_one();
}

}  // namespace cellmap
