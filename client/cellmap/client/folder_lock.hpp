#pragma once

#include <filesystem>

namespace cellmap::client {

/// The right to write to a folder, held by an flock on `<folder>/lock` for as long as this object
/// lives; the kernel gives it back when the process dies.
class FolderLock {
 public:
  /// Throws Error{kConflict} where another process (or object) has it, Error{kIo} where the folder
  /// cannot be written.
  explicit FolderLock(const std::filesystem::path& folder);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  int descriptor_;
};

}  // namespace cellmap::client
