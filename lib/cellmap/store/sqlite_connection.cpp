#include "cellmap/store/sqlite_connection.hpp"

#include <SQLiteCpp/SQLiteCpp.h>
#include <sqlite3.h>

#include "cellmap/core/error.hpp"

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
      throw Error(
          ErrorCode::kDiskFull,
          "store: the disk is full and nothing was changed; free space and repeat" + detail);
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

class SqliteStatement final : public SqlStatement {
 public:
  SqliteStatement(SQLite::Database& database, const std::string& sql) : statement_(database, sql) {}

  void bind(std::int64_t value) override {
    translated([&] { statement_.bind(++bound_, value); });
  }
  void bind(double value) override {
    translated([&] { statement_.bind(++bound_, value); });
  }
  void bind(const std::string& value) override {
    translated([&] { statement_.bind(++bound_, value); });
  }
  void bind(const Bytes& value) override {
    // An empty vector may have a null pointer, which would bind NULL instead of zero bytes.
    const void* const data = value.empty() ? static_cast<const void*>("") : value.data();
    translated([&] { statement_.bind(++bound_, data, static_cast<int>(value.size())); });
  }
  void bind_null(SqlType) override {
    translated([&] { statement_.bind(++bound_); });
  }

  bool step() override {
    return translated([&] { return statement_.executeStep(); });
  }

  void release() noexcept override {
    statement_.tryReset();
    bound_ = 0;
    // Bound values were copied; dropping them frees the memory of blobs. Only a null handle fails.
    try {
      statement_.clearBindings();
    } catch (const SQLite::Exception&) {
    }
  }

  std::int64_t integer(int column) const override { return value(column).getInt64(); }
  double real(int column) const override { return value(column).getDouble(); }
  std::string text(int column) const override { return value(column).getString(); }
  bool is_null(int column) const override { return value(column).isNull(); }
  std::span<const std::byte> bytes(int column) const override {
    const SQLite::Column blob = value(column);
    const void* const data = blob.getBlob();
    return {static_cast<const std::byte*>(data), static_cast<std::size_t>(blob.getBytes())};
  }

 private:
  SQLite::Column value(int column) const { return statement_.getColumn(column); }

  mutable SQLite::Statement statement_;
  int bound_ = 0;
};

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

SqliteConnection::~SqliteConnection() { forget_statements(); }

void SqliteConnection::execute(const char* sql) {
  translated([&] { database_->exec(sql); });
}

bool SqliteConnection::in_transaction() const {
  return sqlite3_get_autocommit(database_->getHandle()) == 0;
}

/// SQLite 3.40 has no other clock with fractions of seconds: days since noon, 1 January 4713 BC.
std::string SqliteConnection::now_ns() const {
  return "CAST((julianday('now') - 2440587.5) * 86400000.0 AS INTEGER) * 1000000";
}

std::unique_ptr<SqlStatement> SqliteConnection::prepare(const std::string& sql) {
  return translated([&] { return std::make_unique<SqliteStatement>(*database_, sql); });
}

}  // namespace cellmap
