#pragma once

#include <filesystem>
#include <memory>

#include "cellmap/store/sql_connection.hpp"

namespace SQLite {
class Database;
}  // namespace SQLite

namespace cellmap {

enum class SqliteAccess { kReadOnly, kReadWrite };

/// A connection to a database in a file.
class SqliteConnection final : public SqlConnection {
 public:
  SqliteConnection(const std::filesystem::path& file, SqliteAccess access, int busy_timeout_ms);
  ~SqliteConnection() override;

  void execute(const char* sql) override;
  void begin_read() override { execute("BEGIN"); }
  void begin_write() override { execute("BEGIN IMMEDIATE"); }
  bool in_transaction() const override;
  std::string now_ns() const override;

 private:
  std::unique_ptr<SqlStatement> prepare(const std::string& sql) override;

  std::unique_ptr<SQLite::Database> database_;
};

}  // namespace cellmap
