#pragma once

#include <filesystem>
#include <memory>

#include "cellmap/store/store.hpp"

namespace cellmap {

struct SqliteStoreOptions {
  std::size_t cache_bytes = 64u << 20;  ///< LRU of hot CELL blobs, zstd frames
  int busy_timeout_ms = 5000;           ///< wait for a lock that a foreign program holds
  std::size_t max_readers = 16;         ///< connections; a further reader waits for a free one
  /// Opens an existing store beside the one process that writes it. Every read works and sees what
  /// was committed last; every change is refused with Error{kUnsupported}.
  bool read_only = false;

  /// Throws Error{kInvalidArgument}: no readers, a negative timeout.
  void validate() const;
};

/// Opens or creates the embedded store: one SQLite file in WAL mode with 16 KiB pages,
/// `synchronous=FULL` and no mmap; beside it `-wal`, `-shm` and `.lock` while it is used. Migrates
/// older schema versions (schema: store/sqlite_schema.cpp).
///
/// One process writes a store: a second one that opens it for writing gets Error{kUnavailable} that
/// names the first. Any number of processes on the same machine may read it (`read_only`).
///
/// Space that a deleted map leaves is used again; the file does not shrink.
///
/// Throws Error{kUnsupported} for a newer schema, for an older one where `read_only`, and for
/// network and FUSE file systems (a WAL needs shared memory and locks that hold); {kCorruptData}
/// for files that are no CELLmap store; {kNotFound} for a missing file where `read_only`; {kIo}
/// where the file cannot be opened; {kUnavailable} as above.
std::unique_ptr<Store> open_sqlite_store(const std::filesystem::path& file,
                                         const SqliteStoreOptions& options = {});

}  // namespace cellmap
