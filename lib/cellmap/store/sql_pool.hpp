#pragma once

#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <vector>

#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

/// Connections, one for each thread that needs one at the moment, opened when first needed. Thread
/// safe.
class SqlPool {
 public:
  using Open = std::function<std::unique_ptr<SqlConnection>()>;
  /// `first`: one that is open already, or null.
  SqlPool(Open open, std::size_t max_connections, std::unique_ptr<SqlConnection> first = nullptr)
      : open_(std::move(open)), max_connections_(max_connections), opened_(first ? 1 : 0) {
    if (first) free_.push_back(std::move(first));
  }

  /// Calls `read(connection)` inside one read transaction: everything it sees is one revision.
  template <typename Read>
  auto read(const Read& read) {
    const Lease lease(*this);
    const Snapshot snapshot(*lease.connection);
    return read(*lease.connection);
  }
  /// Calls `use(connection)`, which ends the transactions that it begins.
  template <typename Use>
  auto lend(const Use& use) {
    const Lease lease(*this);
    return use(*lease.connection);
  }

 private:
  struct Lease {
    explicit Lease(SqlPool& owner) : pool(owner), connection(owner.take()) {}
    ~Lease() { pool.give_back(std::move(connection)); }
    SqlPool& pool;
    std::unique_ptr<SqlConnection> connection;
  };
  struct Snapshot {
    explicit Snapshot(SqlConnection& connection);
    ~Snapshot();
    SqlConnection& connection;
  };

  std::unique_ptr<SqlConnection> take();
  void give_back(std::unique_ptr<SqlConnection> connection);

  const Open open_;
  const std::size_t max_connections_;
  std::mutex mutex_;
  std::condition_variable returned_;
  std::size_t opened_ = 0;
  std::vector<std::unique_ptr<SqlConnection>> free_;
};

}  // namespace cellmap
