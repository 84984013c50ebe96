#pragma once

#include <string>

#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

/// A step of the schema in PostgreSQL's words: other names of types, no tables without row ids.
std::string in_postgres_words(std::string sql);

/// Brings the schema to this build's version, all steps in one transaction that excludes other
/// servers that start at the same time. Error{kUnsupported} for a newer schema.
void migrate_postgres_schema(SqlConnection& connection);

}  // namespace cellmap
