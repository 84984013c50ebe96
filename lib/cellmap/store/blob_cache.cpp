#include "cellmap/store/blob_cache.hpp"

#include <cstring>

namespace cellmap {

std::size_t BlobCache::Hasher::operator()(const ContentHash& hash) const noexcept {
  std::size_t value;  // any eight bytes of a SHA-256 are as good as a hash of all
  std::memcpy(&value, hash.bytes.data(), sizeof(value));
  return value;
}

std::shared_ptr<const Bytes> BlobCache::find(const ContentHash& hash) {
  const std::lock_guard lock(mutex_);
  const auto found = by_hash_.find(hash);
  if (found == by_hash_.end()) return nullptr;
  entries_.splice(entries_.begin(), entries_, found->second);
  return found->second->blob;
}

void BlobCache::insert(const ContentHash& hash, std::shared_ptr<const Bytes> blob) {
  if (blob->size() > capacity_bytes_ / 4) return;
  const std::lock_guard lock(mutex_);
  if (by_hash_.contains(hash)) return;
  bytes_ += blob->size();
  entries_.push_front({hash, std::move(blob)});
  by_hash_.emplace(hash, entries_.begin());
  while (bytes_ > capacity_bytes_) {
    bytes_ -= entries_.back().blob->size();
    by_hash_.erase(entries_.back().hash);
    entries_.pop_back();
  }
}

std::size_t BlobCache::bytes() const {
  const std::lock_guard lock(mutex_);
  return bytes_;
}

}  // namespace cellmap
