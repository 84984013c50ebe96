#pragma once

#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <unordered_map>

#include "cellmap/codec/cell_codec.hpp"

namespace cellmap {

/// The blobs that were read last, up to a number of bytes. Blobs are named by content, so an entry
/// is never wrong, only unused. Thread safe.
class BlobCache {
 public:
  explicit BlobCache(std::size_t capacity_bytes) : capacity_bytes_(capacity_bytes) {}

  /// The blob, or null.
  std::shared_ptr<const Bytes> find(const ContentHash& hash);

  /// Keeps it unless it is larger than a quarter of the cache; drops the longest unused.
  void insert(const ContentHash& hash, std::shared_ptr<const Bytes> blob);

  std::size_t bytes() const;

 private:
  struct Entry {
    ContentHash hash;
    std::shared_ptr<const Bytes> blob;
  };
  struct Hasher {
    std::size_t operator()(const ContentHash& hash) const noexcept;
  };

  const std::size_t capacity_bytes_;
  mutable std::mutex mutex_;
  std::size_t bytes_ = 0;
  std::list<Entry> entries_;  ///< most recently used first
  std::unordered_map<ContentHash, std::list<Entry>::iterator, Hasher> by_hash_;
};

}  // namespace cellmap
