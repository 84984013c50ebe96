#pragma once

#include <condition_variable>
#include <exception>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/error.hpp"

namespace SQLite {
class Database;
class Statement;
}  // namespace SQLite

namespace cellmap {

enum class SqliteAccess { kReadOnly, kReadWrite };

/// One connection with its prepared statements. One thread at a time.
/// Every member throws cellmap::Error: damaged bytes kCorruptData, a full or failing disk kIo, a
/// lock that was not given up in time kUnavailable.
class SqliteConnection {
 public:
  SqliteConnection(const std::filesystem::path& file, SqliteAccess access, int busy_timeout_ms);
  ~SqliteConnection();
  SqliteConnection(const SqliteConnection&) = delete;
  SqliteConnection& operator=(const SqliteConnection&) = delete;

  /// Runs statements without parameters or results.
  void execute(const char* sql);
  /// First column of the first row of a statement or pragma.
  std::int64_t integer(const char* sql);
  std::string text(const char* sql);
  /// False once a transaction was committed or rolled back, also by SQLite itself after an error.
  bool in_transaction() const;

 private:
  friend class Query;
  SQLite::Statement& prepared(std::string_view sql);

  std::unique_ptr<SQLite::Database> database_;
  std::map<std::string, std::unique_ptr<SQLite::Statement>, std::less<>> statements_;
};

/// One execution of a prepared statement: bind in order, then step through the rows. The statement
/// is released when this object dies, so no snapshot outlives its reader. The same SQL must not be
/// executed again while a Query of it lives. Values are always bound, never written into the SQL.
class Query {
 public:
  template <typename... Values>
  Query(SqliteConnection& connection, std::string_view sql, const Values&... values)
      : Query(connection, sql) {
    (bind(values), ...);
  }
  Query(SqliteConnection& connection, std::string_view sql);
  ~Query();
  Query(const Query&) = delete;
  Query& operator=(const Query&) = delete;

  /// Moves to the next row; false after the last.
  bool next();
  /// Runs to the end a statement that gives no rows.
  void run();

  std::int64_t integer(int column) const;
  /// Error{kCorruptData} where the value does not fit.
  std::uint32_t unsigned32(int column) const;
  std::uint64_t unsigned64(int column) const;
  double real(int column) const;
  std::string text(int column) const;
  bool is_null(int column) const;
  /// Valid until the next row.
  std::span<const std::byte> bytes(int column) const;

 private:
  void bind(std::int64_t value);
  void bind(std::uint32_t value) { bind(static_cast<std::int64_t>(value)); }
  void bind(std::uint64_t value) { bind(static_cast<std::int64_t>(value)); }
  void bind(double value);
  void bind(const std::string& value);
  void bind(const Bytes& value);
  void bind(std::nullopt_t);
  template <typename Value>
  void bind(const std::optional<Value>& value) {
    value ? bind(*value) : bind(std::nullopt);
  }

  SQLite::Statement& statement_;
  int bound_ = 0;
};

/// Connections for reading, one for each thread that reads at the moment, opened when first needed.
/// Thread safe.
class SqlitePool {
 public:
  using Open = std::function<std::unique_ptr<SqliteConnection>()>;
  SqlitePool(Open open, std::size_t max_connections)
      : open_(std::move(open)), max_connections_(max_connections) {}

  /// Calls `read(connection)` inside one read transaction: everything it sees is one revision.
  template <typename Read>
  auto read(const Read& read) {
    const Lease lease(*this);
    const Snapshot snapshot(*lease.connection);
    return read(*lease.connection);
  }

 private:
  struct Lease {
    explicit Lease(SqlitePool& owner) : pool(owner), connection(owner.take()) {}
    ~Lease() { pool.give_back(std::move(connection)); }
    SqlitePool& pool;
    std::unique_ptr<SqliteConnection> connection;
  };
  struct Snapshot {
    explicit Snapshot(SqliteConnection& connection);
    ~Snapshot();
    SqliteConnection& connection;
  };

  std::unique_ptr<SqliteConnection> take();
  void give_back(std::unique_ptr<SqliteConnection> connection);

  const Open open_;
  const std::size_t max_connections_;
  std::mutex mutex_;
  std::condition_variable returned_;
  std::size_t opened_ = 0;
  std::vector<std::unique_ptr<SqliteConnection>> free_;
};

}  // namespace cellmap
