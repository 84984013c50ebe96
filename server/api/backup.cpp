#include "server/api/backup.hpp"

#include <array>
#include <chrono>
#include <memory>
#include <mutex>

#include "cellmap/archive/byte_source.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/backup_store.hpp"
#include "server/api/api.hpp"
#include "server/api/conditions.hpp"
#include "server/api/problem.hpp"

// GET /v1/backup.

namespace cellmap::server {
namespace {

constexpr const char* kType = "application/vnd.sqlite3";
constexpr const char* kFileName = "cellmap-backup.db";
constexpr std::chrono::seconds kBackupPatience{10};

/// The backup that is being fetched, in parts, in a file without a name. There is one at a time,
/// since each takes as much disk as the store; its last byte or the next backup ends it. Thread
/// safe.
class BackupFile {
 public:
  struct Entry {
    std::string etag;
    std::shared_ptr<ByteFile> file;
  };

  /// What is there under this condition, else, without one, a new backup.
  Entry open(Services& services, std::optional<std::string_view> if_match) {
    const std::unique_lock lock(mutex_, kBackupPatience);
    if (!lock) throw Error(ErrorCode::kUnavailable, "Another backup is being made; try again.");
    if (if_match) {
      if (kept_.file && matches_etag(*if_match, std::array{kept_.etag})) return kept_;
      throw Error(ErrorCode::kPreconditionFailed, "That backup is gone; begin anew.");
    }
    kept_ = {};  // first, for its room
    const auto path = services.options.spool_folder / kFileName;
    std::error_code ignored;
    std::filesystem::remove(path, ignored);  // of a server that was killed
    backups_of(services.store).back_up(path);
    kept_.file = open_file(path, FileMode::kRead);
    std::filesystem::remove(path);
    kept_.etag = '"' + std::to_string(Clock::now().time_since_epoch().count()) + '"';
    return kept_;
  }

  void forget(const std::string& etag) {
    const std::lock_guard lock(mutex_);
    if (kept_.etag == etag) kept_ = {};
  }

 private:
  using Clock = std::chrono::system_clock;
  std::timed_mutex mutex_;
  Entry kept_;
};

Response get_backup(Services& services, BackupFile& backup, const Call& call) {
  const auto [etag, file] = backup.open(services, call.header("If-Match"));
  Response response;
  response.headers.set("ETag", etag);
  response.headers.set("Accept-Ranges", "bytes");
  response.headers.set("Cache-Control", "no-store");
  response.headers.set("Content-Type", kType);
  response.headers.set("Content-Disposition",
                       std::string("attachment; filename=\"") + kFileName + "\"");
  const std::uint64_t size = file->size();
  const auto part = answer_range(call.header("Range"), size, response);
  if (!part) return range_not_satisfiable(size);
  if (part->offset + part->length == size) backup.forget(etag);
  if (call.method() != "HEAD") response.body = FileBody{file, part->offset, part->length};
  return response;
}

}  // namespace

void add_backup_route(Router& router, Services& services) {
  const auto backup = std::make_shared<BackupFile>();
  router.add({"GET",
              "/v1/backup",
              {},
              0,
              {kType},
              [&, backup](const Call& call) { return get_backup(services, *backup, call); },
              true});
}

}  // namespace cellmap::server
