#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/id.hpp"

namespace cellmap {

/// What can be wrong with a store's file.
enum class StoreDamage : std::uint8_t {
  kFile,       ///< "file": SQLite's own structures; indices can be made anew, tables cannot
  kContent,    ///< "content": the bytes of a CELL are missing, damaged, or not those of their hash
  kReference,  ///< "reference": a row names another that is not there
  kPose,       ///< "pose": a CELL's present or first pose is not in the history of poses
  kDrive,      ///< "drive": the scans of a CELL or the row of its session are missing
  kRevision,   ///< "revision": something is of a revision that its map has not reached
  kCount,      ///< "count": a sum that a map keeps is wrong
  kUnused,     ///< "unused": contents that no CELL has
};
/// Stable lower-case name, for example "content".
std::string_view to_string(StoreDamage damage);

struct StoreFinding {
  StoreDamage damage;
  std::string map;             ///< empty where it concerns none
  std::optional<CellId> cell;  ///< where it concerns one
  std::string what;            ///< one line, for users
};

struct StoreReport {
  std::uint64_t maps = 0, cells = 0, contents = 0;  ///< that were looked at
  std::uint64_t content_bytes = 0;                  ///< as kept
  std::int64_t schema = 0;
  std::vector<StoreFinding> findings;
  /// What is no damage but worth knowing: revisions without a trace, maps that were being made.
  std::vector<std::string> notes;
  /// At most this many findings of a kind are listed; a note counts the others.
  static constexpr std::size_t kMaxFindings = 1000;
};

using StoreProgress = std::function<void(std::uint64_t done, std::uint64_t total)>;

/// Reads a whole store, which may be served meanwhile, at one revision: structure of the file,
/// every reference, the sums, revisions, and every CELL's bytes against checksum and content hash.
/// Changes nothing. `progress` counts contents. Throws Error{kNotFound}, {kUnsupported} for a
/// schema that is not of this program, {kCorruptData} for a file that is no store or cannot be read
/// as one, {kIo}, {kCancelled}. O(file).
StoreReport check_store(const std::filesystem::path& file, const std::stop_token& stop = {},
                        const StoreProgress& progress = {});

struct StoreRepair {
  std::vector<std::string> done;  ///< what was mended without loss
  std::vector<std::string> lost;  ///< what is gone, one line each
};

/// Mends what can be, in one transaction, with nobody else writing the store (else
/// Error{kUnavailable}); then `check_store` finds nothing but what it says cannot be mended. CELLs
/// whose bytes are gone leave their map, with their poses and constraints; of such a map revisions
/// from before can no longer be read. Never drops anything that `lost` does not name. Keep a copy
/// of the file. Throws as `check_store`; {kCorruptData} where tables themselves are damaged:
/// restore a backup then.
StoreRepair repair_store(const std::filesystem::path& file, const std::stop_token& stop = {});

}  // namespace cellmap
