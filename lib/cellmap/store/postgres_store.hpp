#pragma once

#include <memory>
#include <optional>
#include <string>

#include "cellmap/store/object_store.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

struct PostgresStoreOptions {
  std::size_t cache_bytes = 64u << 20;  ///< LRU of hot CELL blobs, zstd frames
  std::size_t max_readers = 16;         ///< connections; a further reader waits for a free one
  std::size_t max_writers = 8;          ///< as many maps are written at the same time from here
  /// Where the bytes of CELLs to come go; nullopt: into the database. What is there already is read
  /// wherever it is.
  std::optional<ObjectStoreOptions> objects{};
  bool one_by_one = false;  ///< no pipelining: to measure what that brings

  /// Throws Error{kInvalidArgument}: no readers or writers, no such object store.
  void validate() const;
};

/// Opens the store in a PostgreSQL database, which must be there (`createdb`), and makes or
/// migrates its tables (schema: store/sql_schema.cpp), in the first schema of the connection's
/// search_path. Tested on PostgreSQL 15.
///
/// Any number of processes on any number of machines may open it for reading and writing; a client
/// that saw a revision through one never sees less through another. `Store::committed` is notified
/// twice a second too, since other processes commit as well.
///
/// `address`: as libpq reads it, several hosts included
/// ("postgresql://a,b/maps?target_session_attrs=read-write" finds the primary after a failover).
///
/// Throws Error{kInvalidArgument} for an address that libpq does not understand, {kUnavailable}
/// where nobody answers or lets us in, {kUnsupported} for a newer schema or a program that was
/// built without libpq.
std::unique_ptr<Store> open_postgres_store(const std::string& address,
                                           const PostgresStoreOptions& options = {});

}  // namespace cellmap
