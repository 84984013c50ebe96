#include "cellmap/store/sqlite_connection.hpp"

#include <SQLiteCpp/SQLiteCpp.h>
#include <sqlite3.h>

#include <limits>

#include "cellmap/core/disk_full.hpp"

namespace cellmap {
namespace {

[[noreturn]] void rethrow(const SQLite::Exception& exception) {
  const int extended = exception.getExtendedErrorCode();
  const std::string detail =
      std::string(" (SQLite ") + std::to_string(extended) + ": " + exception.what() + ")";
  switch (exception.getErrorCode() & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      throw Error(
          ErrorCode::kCorruptData,
          "store: its file is damaged or no store at all; restore it from a backup" + detail);
    case SQLITE_FULL:
      throw DiskFull("store: the disk is full and nothing was changed; free space and repeat" +
                     detail);
    case SQLITE_IOERR:
    case SQLITE_CANTOPEN:
    case SQLITE_PERM:
    case SQLITE_READONLY:
      throw Error(
          ErrorCode::kIo,
          "store: the file cannot be read or written; check the disk, its free space and the "
          "permissions of the file and its folder" +
              detail);
    case SQLITE_NOMEM:
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      throw Error(ErrorCode::kUnavailable, "store: busy; try again" + detail);
    default:
      throw Error(ErrorCode::kInternal, "store: unexpected database error" + detail);
  }
}

/// Runs `body` and turns the database's exceptions into ours.
template <typename Body>
auto translated(const Body& body) {
  try {
    return body();
  } catch (const SQLite::Exception& exception) {
    rethrow(exception);
  }
}

[[noreturn]] void corrupt_value() {
  throw Error(
      ErrorCode::kCorruptData,
      "store: a value is outside its range, so the file is damaged; restore it from a backup");
}

}  // namespace

SqliteConnection::SqliteConnection(const std::filesystem::path& file, SqliteAccess access,
                                   int busy_timeout_ms) {
  translated([&] {
    const int flags = access == SqliteAccess::kReadOnly
                          ? SQLite::OPEN_READONLY
                          : SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE;
    database_ = std::make_unique<SQLite::Database>(file.string(), flags | SQLite::OPEN_NOMUTEX,
                                                   busy_timeout_ms);
  });
}

SqliteConnection::~SqliteConnection() = default;

void SqliteConnection::execute(const char* sql) {
  translated([&] { database_->exec(sql); });
}

std::int64_t SqliteConnection::integer(const char* sql) {
  return translated([&] { return database_->execAndGet(sql).getInt64(); });
}

std::string SqliteConnection::text(const char* sql) {
  return translated([&] { return database_->execAndGet(sql).getString(); });
}

bool SqliteConnection::in_transaction() const {
  return sqlite3_get_autocommit(database_->getHandle()) == 0;
}

SQLite::Statement& SqliteConnection::prepared(std::string_view sql) {
  const auto found = statements_.find(sql);
  if (found != statements_.end()) return *found->second;
  const std::string text(sql);
  auto statement =
      translated([&] { return std::make_unique<SQLite::Statement>(*database_, text); });
  return *statements_.emplace(text, std::move(statement)).first->second;
}

Query::Query(SqliteConnection& connection, std::string_view sql)
    : statement_(connection.prepared(sql)) {}

Query::~Query() {
  statement_.tryReset();
  // Bound values were copied; dropping them frees the memory of blobs. Only a null handle can fail.
  try {
    statement_.clearBindings();
  } catch (const SQLite::Exception&) {
  }
}

bool Query::next() {
  return translated([&] { return statement_.executeStep(); });
}

void Query::run() {
  translated([&] { statement_.exec(); });
}

std::int64_t Query::integer(int column) const { return statement_.getColumn(column).getInt64(); }

std::uint64_t Query::unsigned64(int column) const {
  const std::int64_t value = integer(column);
  if (value < 0) corrupt_value();
  return static_cast<std::uint64_t>(value);
}

std::uint32_t Query::unsigned32(int column) const {
  const std::uint64_t value = unsigned64(column);
  if (value > std::numeric_limits<std::uint32_t>::max()) corrupt_value();
  return static_cast<std::uint32_t>(value);
}

double Query::real(int column) const { return statement_.getColumn(column).getDouble(); }

std::string Query::text(int column) const { return statement_.getColumn(column).getString(); }

bool Query::is_null(int column) const { return statement_.getColumn(column).isNull(); }

std::span<const std::byte> Query::bytes(int column) const {
  const SQLite::Column value = statement_.getColumn(column);
  const void* const data = value.getBlob();
  return {static_cast<const std::byte*>(data), static_cast<std::size_t>(value.getBytes())};
}

void Query::bind(std::int64_t value) {
  translated([&] { statement_.bind(++bound_, value); });
}

void Query::bind(double value) {
  translated([&] { statement_.bind(++bound_, value); });
}

void Query::bind(const std::string& value) {
  translated([&] { statement_.bind(++bound_, value); });
}

void Query::bind(const Bytes& value) {
  // An empty vector may have a null pointer, which would bind NULL instead of zero bytes.
  const void* const data = value.empty() ? static_cast<const void*>("") : value.data();
  translated([&] { statement_.bind(++bound_, data, static_cast<int>(value.size())); });
}

void Query::bind(std::nullopt_t) {
  translated([&] { statement_.bind(++bound_); });
}

SqlitePool::Snapshot::Snapshot(SqliteConnection& reader) : connection(reader) {
  connection.execute("BEGIN");
}

SqlitePool::Snapshot::~Snapshot() {
  // ROLLBACK of a transaction that only read cannot fail in a way that matters; an error that the
  // reader saw has been thrown already.
  try {
    if (connection.in_transaction()) connection.execute("ROLLBACK");
  } catch (const Error&) {
  }
}

std::unique_ptr<SqliteConnection> SqlitePool::take() {
  std::unique_lock lock(mutex_);
  returned_.wait(lock, [&] { return !free_.empty() || opened_ < max_connections_; });
  if (!free_.empty()) {
    std::unique_ptr<SqliteConnection> connection = std::move(free_.back());
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

void SqlitePool::give_back(std::unique_ptr<SqliteConnection> connection) {
  const std::lock_guard lock(mutex_);
  free_.push_back(std::move(connection));
  returned_.notify_one();
}

}  // namespace cellmap
