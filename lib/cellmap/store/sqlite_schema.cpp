#include "cellmap/store/sqlite_schema.hpp"

#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/store/sql_schema.hpp"

namespace cellmap {
namespace {

void apply_migration(SqliteConnection& connection, std::size_t version) {
  connection.begin_write();
  try {
    connection.execute(sql_schema_steps()[version]);
    connection.execute(("PRAGMA application_id = " + std::to_string(kSqliteApplicationId)).c_str());
    connection.execute(("PRAGMA user_version = " + std::to_string(version + 1)).c_str());
    connection.execute("COMMIT");
  } catch (...) {
    if (connection.in_transaction()) connection.execute("ROLLBACK");
    throw;
  }
}

}  // namespace

std::int64_t sqlite_schema_version() {
  return static_cast<std::int64_t>(sql_schema_steps().size());
}

void require_our_schema(SqliteConnection& connection) {
  const std::int64_t application = connection.integer("PRAGMA application_id");
  const std::int64_t version = connection.integer("PRAGMA user_version");
  const bool empty = connection.integer("SELECT COUNT(*) FROM sqlite_master") == 0;
  if (application == 0 && version == 0 && empty) return;
  if (application != kSqliteApplicationId || version < 1) {
    throw Error(ErrorCode::kCorruptData,
                "store: the file is an SQLite database, but no CELLmap store; name another file");
  }
  if (version > sqlite_schema_version()) {
    throw Error(ErrorCode::kUnsupported,
                "store: its schema has version " + std::to_string(version) +
                    ", this program knows versions up to " +
                    std::to_string(sqlite_schema_version()) + "; use a newer program");
  }
}

void require_current_schema(SqliteConnection& connection) {
  require_our_schema(connection);
  if (connection.integer("PRAGMA user_version") < sqlite_schema_version()) {
    throw Error(ErrorCode::kUnsupported,
                "store: its schema is older than this program or empty; open it once for writing");
  }
}

void migrate_schema(SqliteConnection& connection) {
  require_our_schema(connection);
  const auto version = static_cast<std::size_t>(connection.integer("PRAGMA user_version"));
  for (std::size_t step = version; step < sql_schema_steps().size(); ++step) {
    apply_migration(connection, step);
  }
}

}  // namespace cellmap
