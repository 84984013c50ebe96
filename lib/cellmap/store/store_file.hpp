#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

namespace cellmap {

/// The name of a file system whose statfs magic number says that it is shared over a network or
/// runs in user space, where neither locks nor shared memory can be relied on; nullopt for a local
/// one.
std::optional<std::string_view> network_file_system(long magic);

/// Throws Error{kUnsupported} where the folder of `file` lies on such a file system, and
/// Error{kIo} where the folder does not exist.
void require_local_file_system(const std::filesystem::path& file);

/// Throws Error{kCorruptData} for a non-empty file that does not begin as an SQLite database does,
/// and Error{kIo} for one that cannot be read. A missing or empty file passes.
void require_sqlite_or_empty(const std::filesystem::path& file);

/// Exclusive right to write a store, held by an flock on `<file>.lock` for as long as this object
/// lives. The kernel gives it back when the process dies, so no stale lock can remain; the lock
/// file itself stays, because deleting it would race with the next owner.
class WriterLock {
 public:
  /// Throws Error{kUnavailable} where someone else, in this process or another, holds it.
  explicit WriterLock(const std::filesystem::path& file);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

 private:
  int descriptor_;
};

}  // namespace cellmap
