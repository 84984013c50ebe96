#include "cellmap/store/sqlite_store.hpp"

#include "cellmap/core/error.hpp"
#include "cellmap/store/backup_store.hpp"
#include "cellmap/store/sql_store.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_schema.hpp"
#include "cellmap/store/store_file.hpp"

namespace cellmap {
namespace {

/// A WAL that cannot be checkpointed yet, and some.
constexpr std::uintmax_t kMinFreeBytes = 32u << 20;

std::unique_ptr<SqliteConnection> open_connection(const std::filesystem::path& file,
                                                  SqliteAccess access,
                                                  const SqliteStoreOptions& options) {
  auto connection = std::make_unique<SqliteConnection>(file, access, options.busy_timeout_ms);
  connection->execute("PRAGMA mmap_size = 0");  // cold reads through it are ten times slower
  connection->execute("PRAGMA trusted_schema = OFF");
  connection->execute("PRAGMA cell_size_check = ON");
  return connection;
}

std::unique_ptr<SqliteConnection> open_writer(const std::filesystem::path& file,
                                              const SqliteStoreOptions& options) {
  auto connection = open_connection(file, SqliteAccess::kReadWrite, options);
  require_our_schema(*connection);  // before anything is written to what may be another's file
  connection->execute("PRAGMA page_size = 16384");
  if (connection->text("PRAGMA journal_mode = WAL") != "wal") {
    throw Error(ErrorCode::kUnsupported,
                "store " + file.string() +
                    ": the file system does not support a write-ahead log; keep the store on a "
                    "local disk");
  }
  connection->execute("PRAGMA synchronous = FULL");
  connection->execute("PRAGMA foreign_keys = ON");
  connection->execute("PRAGMA journal_size_limit = 67108864");
  migrate_schema(*connection);
  return connection;
}

class SqliteStore final : public SqlStore, public Backups {
 public:
  SqliteStore(std::filesystem::path file, SqlEngine engine)
      : SqlStore(std::move(engine)), file_(std::move(file)) {}

  void back_up(const std::filesystem::path& to, const std::stop_token& stop,
               const BackupProgress& progress) const override {
    backup_store(file_, to, stop, progress);
  }

  void check_ready() const override {
    SqlStore::check_ready();
    std::error_code error;
    const auto space = std::filesystem::space(file_, error);
    if (error || space.available < kMinFreeBytes) {
      throw Error(ErrorCode::kIo, "store: less than 32 MiB are free on its disk; free space");
    }
  }

 private:
  const std::filesystem::path file_;
};

}  // namespace

void SqliteStoreOptions::validate() const {
  if (max_readers < 1 || busy_timeout_ms < 0) {
    throw Error(ErrorCode::kInvalidArgument,
                "store options: expected at least one reader and a timeout of at least 0 ms");
  }
}

std::unique_ptr<Store> open_sqlite_store(const std::filesystem::path& file,
                                         const SqliteStoreOptions& options) {
  options.validate();
  if (!file.has_filename()) {
    throw Error(ErrorCode::kInvalidArgument, "store: expected the name of a file");
  }
  // One name for one file, whichever way leads to it, because the lock goes by the name.
  const std::filesystem::path path = std::filesystem::weakly_canonical(file);
  if (options.read_only && !std::filesystem::exists(path)) {
    throw Error(ErrorCode::kNotFound, "store " + path.string() + " does not exist");
  }
  require_local_file_system(path);
  require_sqlite_or_empty(path);
  SqlEngine engine;
  engine.name = path.string();
  engine.max_readers = options.max_readers;
  engine.cache_bytes = options.cache_bytes;
  engine.open_reader = [path, options] {
    return open_connection(path, SqliteAccess::kReadOnly, options);
  };
  if (options.read_only) {
    require_current_schema(*open_connection(path, SqliteAccess::kReadOnly, options));
  } else {
    engine.held = std::make_shared<const WriterLock>(path);
    engine.writer = open_writer(path, options);
    engine.is_only_writer = true;  // as the lock sees to
  }
  return std::make_unique<SqliteStore>(path, std::move(engine));
}

}  // namespace cellmap
