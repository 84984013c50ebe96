#include "cellmap/store/backup_store.hpp"

#include <SQLiteCpp/Backup.h>
#include <SQLiteCpp/SQLiteCpp.h>
#include <fcntl.h>
#include <sqlite3.h>
#include <unistd.h>

#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_schema.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {
namespace {

constexpr int kPagesAStep = 256;

[[noreturn]] void fail(const SQLite::Exception& error) {
  const std::string detail = std::string(" (SQLite: ") + error.what() + ")";
  if (error.getErrorCode() == SQLITE_FULL) {
    throw Error(ErrorCode::kDiskFull, "backup: the disk is full; free space and repeat" + detail);
  }
  throw Error(ErrorCode::kIo, "backup: the copy cannot be written; check the disk" + detail);
}

/// The name under which a copy is written until it is whole.
class PartFile {
 public:
  explicit PartFile(const std::filesystem::path& file) : file_(file), part_(file) {
    part_ += ".part";
    remove();
  }
  ~PartFile() { remove(); }
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;

  const std::filesystem::path& path() const { return part_; }
  void finish() const {
    std::filesystem::rename(part_, file_);
    const auto folder = file_.has_parent_path() ? file_.parent_path() : ".";
    const int descriptor = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0) return;  // the name may be lost with the machine; the bytes are not
    ::fsync(descriptor);
    ::close(descriptor);
  }

 private:
  void remove() const {
    for (const char* const suffix : {"", "-journal", "-wal", "-shm"}) {
      std::error_code ignored;
      std::filesystem::remove(part_.string() + suffix, ignored);
    }
  }
  std::filesystem::path file_, part_;
};

void copy(const std::filesystem::path& from, const std::filesystem::path& to,
          const std::stop_token& stop, const BackupProgress& progress) {
  SQLite::Database source(from.string(), SQLite::OPEN_READONLY, 5000);
  // Held until the end: writers go on, and what they write is not seen.
  SQLite::Statement snapshot(source, "SELECT COUNT(*) FROM map");
  source.exec("BEGIN");
  snapshot.executeStep();
  SQLite::Database target(to.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  const auto page_bytes =
      static_cast<std::uint64_t>(source.execAndGet("PRAGMA page_size").getInt64());
  SQLite::Backup backup(target, "main", source, "main");
  for (;;) {
    throw_if_stopped(stop);
    const int result = backup.executeStep(kPagesAStep);
    const auto total = static_cast<std::uint64_t>(backup.getTotalPageCount());
    const auto left = static_cast<std::uint64_t>(backup.getRemainingPageCount());
    if (progress) progress((total - left) * page_bytes, total * page_bytes);
    if (result == SQLITE_DONE) return;
  }
}

}  // namespace

const Backups& backups_of(const Store& store) {
  if (const auto* backups = dynamic_cast<const Backups*>(&store)) return *backups;
  throw Error(ErrorCode::kUnsupported, "this store makes no backups; its engine has its own means");
}

void backup_store(const std::filesystem::path& from, const std::filesystem::path& to,
                  const std::stop_token& stop, const BackupProgress& progress) {
  if (!std::filesystem::exists(from)) {
    throw Error(ErrorCode::kNotFound, "store " + from.string() + " does not exist");
  }
  if (std::filesystem::exists(to)) {
    throw Error(ErrorCode::kAlreadyExists,
                "'" + to.string() + "' is there already; name another file");
  }
  {
    SqliteConnection ours(from, SqliteAccess::kReadOnly, 5000);
    require_our_schema(ours);
  }
  const PartFile part(to);
  try {
    copy(from, part.path(), stop, progress);
  } catch (const SQLite::Exception& error) {
    fail(error);
  }
  part.finish();
}

}  // namespace cellmap
