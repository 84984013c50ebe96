#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <stop_token>

namespace cellmap {

class Store;

using BackupProgress = std::function<void(std::uint64_t done_bytes, std::uint64_t total_bytes)>;

/// Copies a store, which may be served and written meanwhile, at one revision into a file of its
/// own, which is a store: to restore it, put it where the store was, with nothing beside it. The
/// file appears whole or not at all. Throws Error{kAlreadyExists} where `to` is there, {kNotFound}
/// without a store, {kIo}, {kDiskFull}, {kCancelled}. O(file).
void backup_store(const std::filesystem::path& from, const std::filesystem::path& to,
                  const std::stop_token& stop = {}, const BackupProgress& progress = {});

/// A store that knows where its file is.
class Backups {
 public:
  virtual ~Backups() = default;
  /// As `backup_store`.
  virtual void back_up(const std::filesystem::path& to, const std::stop_token& stop = {},
                       const BackupProgress& progress = {}) const = 0;
};

/// The backups of a store. Throws Error{kUnsupported} for an engine that makes none.
const Backups& backups_of(const Store& store);

}  // namespace cellmap
