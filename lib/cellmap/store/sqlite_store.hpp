#pragma once

#include <filesystem>
#include <memory>

#include "cellmap/store/store.hpp"

namespace cellmap {

struct SqliteStoreOptions {
  std::size_t cache_bytes = 64u << 20;  ///< LRU of hot CELL blobs
  int busy_timeout_ms = 5000;
  std::size_t max_readers = 16;  ///< connections; a further reader waits for a free one
};

/// Opens or creates the embedded store: one SQLite file in WAL mode with 16 KiB pages,
/// `synchronous=FULL` and no mmap. Migrates older schema versions; refuses newer ones with
/// Error{kUnsupported}, files that are no CELLmap store with Error{kCorruptData}, and network file
/// systems (WAL needs shared memory) with Error{kUnsupported}.
std::unique_ptr<Store> open_sqlite_store(const std::filesystem::path& file,
                                         const SqliteStoreOptions& options = {});

}  // namespace cellmap
