#include "cellmap/store/blobs.hpp"

#include <algorithm>
#include <atomic>
#include <exception>
#include <mutex>
#include <thread>

#include "cellmap/core/error.hpp"
#include "cellmap/store/sql_cells.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kAtATime = 8;

/// In 256 folders, for services that keep them as files.
std::string name_of(const ContentHash& checksum) {
  const std::string hex = to_hex(checksum);
  return hex.substr(0, 2) + "/" + hex;
}

Error damaged(const ContentHash& content, const char* how) {
  return Error(ErrorCode::kCorruptData, "store: the bytes of CELL content " + to_hex(content) +
                                            " are " + how + "; restore them from a backup");
}

}  // namespace

Blobs::Blobs(const std::optional<ObjectStoreOptions>& objects)
    : objects_(objects ? open_object_store(*objects) : nullptr) {}

void Blobs::put(const std::vector<const Bytes*>& frames) const {
  if (!objects_) return;
  std::atomic<std::size_t> next = 0;
  std::mutex mutex;
  std::exception_ptr failure;
  const auto work = [&] {
    try {
      for (std::size_t i = next++; i < frames.size(); i = next++) {
        objects_->put(name_of(sha256(*frames[i])), *frames[i]);
      }
    } catch (...) {
      next = frames.size();
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t i = 1; i < std::min(kAtATime, frames.size()); ++i) others.emplace_back(work);
    work();
  }
  if (failure) std::rethrow_exception(failure);
}

std::shared_ptr<const Bytes> Blobs::frame_of(const ContentHash& content, const BlobRow& row) const {
  std::shared_ptr<const Bytes> frame = row.frame;
  if (row.object_bytes) {
    if (!objects_) {
      throw Error(
          ErrorCode::kUnsupported,
          "store: the bytes of its CELLs are in an object store; name it (cellmapd --blobs, "
          "for cellmap the environment's CELLMAP_BLOBS)");
    }
    std::optional<Bytes> object = objects_->get(name_of(row.checksum), *row.object_bytes);
    if (!object) throw damaged(content, "missing in the object store");
    frame = std::make_shared<const Bytes>(std::move(*object));
  }
  if (sha256(*frame) != row.checksum) throw damaged(content, "damaged");
  return frame;
}

void Blobs::check_ready() const {
  if (objects_) (void)objects_->get("ready", 1024);  // what is not there is an answer too
}

BlobRow read_blob_row(SqlConnection& connection, const ContentHash& content) {
  const auto raw = std::as_bytes(std::span(content.bytes));
  Query row(connection, "SELECT frame, checksum, frame_bytes FROM blob WHERE hash = ?",
            Bytes(raw.begin(), raw.end()));
  if (!row.next()) throw damaged(content, "missing");
  BlobRow blob;
  blob.checksum = hash_from(row.bytes(1));
  if (row.is_null(2)) {
    blob.frame = std::make_shared<const Bytes>(row.bytes(0).begin(), row.bytes(0).end());
  } else {
    blob.object_bytes = row.unsigned64(2);
  }
  return blob;
}

}  // namespace cellmap
