#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/id.hpp"

namespace cellmap {

struct CellCacheOptions {
  std::filesystem::path directory;       ///< made where it is missing
  std::uint64_t max_bytes = 1ull << 30;  ///< the least recently used CELLs go beyond this
};

/// CELLs on disk, each in a file named for its content hash, so that nothing in it can be out of
/// date. A file is written whole or not at all (temporary file, then rename) and its hash is
/// checked when it is read: a damaged one is removed and counts as missing. Beside the CELLs it
/// remembers which hash a server last gave for a CELL's id, which lets the next fetch be
/// conditional.
///
/// Not durable: losing it costs transfers only. Several processes may share one directory; within
/// a process one object serves one thread at a time. Throws Error{kIo} where the directory cannot
/// be made or written.
class CellCache {
 public:
  explicit CellCache(CellCacheOptions options);

  /// The bytes of a CELL, or nullopt where they are missing or damaged. Costs one read and one
  /// SHA-256 of the CELL.
  std::optional<Bytes> get(const ContentHash& hash);

  /// Keeps a CELL whose hash the caller has verified; then removes the least recently used ones
  /// beyond `max_bytes`.
  void put(const EncodedCell& cell);

  /// The hash last remembered for a CELL of a map of a server; a hint, to be confirmed by the
  /// server.
  std::optional<ContentHash> remembered_hash(const std::string& map_url, CellId id) const;
  void remember_hash(const std::string& map_url, CellId id, const ContentHash& hash);

  /// Where the CELL of a hash is kept, whether it is there or not.
  std::filesystem::path path_of(const ContentHash& hash) const;

 private:
  void evict();

  CellCacheOptions options_;
  std::uint64_t bytes_ = 0;  ///< of all CELLs in the directory, as far as this object knows
};

}  // namespace cellmap
