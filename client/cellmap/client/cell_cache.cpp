#include "cellmap/client/cell_cache.hpp"

#include <algorithm>
#include <vector>

#include "cellmap/client/files.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace fs = std::filesystem;
using client::as_bytes;
using client::make_directory;
using client::read_file;
using client::write_file_atomically;
namespace {

struct CachedFile {
  fs::file_time_type used;
  std::uint64_t bytes = 0;
  fs::path path;
};

/// Every CELL file. Others may remove files meanwhile: what vanished is left out.
std::vector<CachedFile> cached_files(const fs::path& directory) {
  std::vector<CachedFile> files;
  std::error_code error;
  fs::recursive_directory_iterator entry(directory, error), end;
  for (; !error && entry != end; entry.increment(error)) {
    if (entry->path().extension() != ".cell") continue;
    std::error_code gone;
    const auto bytes = entry->file_size(gone);
    const auto used = entry->last_write_time(gone);
    if (!gone) files.push_back({used, bytes, entry->path()});
  }
  return files;
}

}  // namespace

CellCache::CellCache(CellCacheOptions options) : options_(std::move(options)) {
  make_directory(options_.directory / "cells");
  for (const CachedFile& file : cached_files(options_.directory / "cells")) bytes_ += file.bytes;
}

fs::path CellCache::path_of(const ContentHash& hash) const {
  const std::string hex = to_hex(hash);
  return options_.directory / "cells" / hex.substr(0, 2) / (hex + ".cell");
}

std::optional<Bytes> CellCache::get(const ContentHash& hash) {
  const fs::path file = path_of(hash);
  std::error_code ignored;
  try {
    std::optional<Bytes> bytes = read_file(file, kMaxCellBytes);
    if (!bytes) return std::nullopt;
    if (verified_hash(*bytes) == hash) {
      fs::last_write_time(file, fs::file_time_type::clock::now(), ignored);
      return bytes;
    }
  } catch (const Error&) {
    // Damaged or unreadable: a cache answers "missing" and makes room for a good copy.
  }
  fs::remove(file, ignored);
  return std::nullopt;
}

void CellCache::put(const EncodedCell& cell) {
  const fs::path file = path_of(cell.hash);
  make_directory(file.parent_path());
  write_file_atomically(file, cell.bytes);
  bytes_ += cell.bytes.size();
  if (bytes_ > options_.max_bytes) evict();
}

void CellCache::evict() {
  std::vector<CachedFile> files = cached_files(options_.directory / "cells");
  std::sort(files.begin(), files.end(),
            [](const CachedFile& a, const CachedFile& b) { return a.used < b.used; });
  bytes_ = 0;
  for (const CachedFile& file : files) bytes_ += file.bytes;
  for (const CachedFile& file : files) {
    if (bytes_ <= options_.max_bytes) break;
    std::error_code ignored;
    fs::remove(file.path, ignored);
    bytes_ -= file.bytes;
  }
}

namespace {

fs::path hint_file(const fs::path& directory, const std::string& map_url, CellId id) {
  const std::string folder = to_hex(sha256(as_bytes(map_url))).substr(0, 16);
  return directory / "etags" / folder / std::to_string(id.value);
}

}  // namespace

std::optional<ContentHash> CellCache::remembered_hash(const std::string& map_url, CellId id) const {
  try {
    const auto bytes = read_file(hint_file(options_.directory, map_url, id), 64);
    if (!bytes) return std::nullopt;
    return content_hash_from_hex(
        std::string(reinterpret_cast<const char*>(bytes->data()), bytes->size()));
  } catch (const Error&) {
    return std::nullopt;  // a damaged hint is no hint
  }
}

void CellCache::remember_hash(const std::string& map_url, CellId id, const ContentHash& hash) {
  const fs::path file = hint_file(options_.directory, map_url, id);
  make_directory(file.parent_path());
  write_file_atomically(file, to_hex(hash));
}

}  // namespace cellmap
