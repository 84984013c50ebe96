#pragma once

#include <cstdint>

#include "cellmap/store/sqlite_connection.hpp"

namespace cellmap {

/// "CELL" in ASCII, in the SQLite header: tells `file` and us whose database it is.
constexpr std::int64_t kSqliteApplicationId = 0x43454C4C;

/// Version of the schema that this build reads and writes, in the header's user_version.
std::int64_t sqlite_schema_version();

/// Throws Error{kCorruptData} for another program's database and Error{kUnsupported} for a newer
/// schema. An empty database passes.
void require_our_schema(SqliteConnection& connection);

/// The same, and Error{kUnsupported} for an older schema: for those who must not migrate it.
void require_current_schema(SqliteConnection& connection);

/// Brings the schema to this build's version, each step in its own transaction. Throws as above.
void migrate_schema(SqliteConnection& connection);

}  // namespace cellmap
