#include "cellmap/store/sqlite_store.hpp"

#include <chrono>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/store/backup_store.hpp"
#include "cellmap/store/documents.hpp"
#include "cellmap/store/group_commit.hpp"
#include "cellmap/store/sqlite_cells.hpp"
#include "cellmap/store/sqlite_reads.hpp"
#include "cellmap/store/sqlite_schema.hpp"
#include "cellmap/store/sqlite_staging.hpp"
#include "cellmap/store/sqlite_update.hpp"
#include "cellmap/store/sqlite_writes.hpp"
#include "cellmap/store/staging.hpp"
#include "cellmap/store/store_file.hpp"
#include "cellmap/store/validation.hpp"

namespace cellmap {
namespace {

constexpr std::chrono::milliseconds kGroupCommitWait(5);
constexpr std::size_t kGroupCommitBatch = 256;
constexpr std::uintmax_t kMinFreeBytes = 32u
                                         << 20;  // a WAL that cannot be checkpointed yet, and some

Stamp now() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

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

/// What a process needs to change a store.
struct SqliteWriter {
  SqliteWriter(const std::filesystem::path& file, const SqliteStoreOptions& options)
      : lock(file), connection(open_writer(file, options)) {}

  WriterLock lock;
  std::unique_ptr<SqliteConnection> connection;
};

class SqliteStore final : public Store, public Documents, public Staging, public Backups {
 public:
  SqliteStore(const std::filesystem::path& file, const SqliteStoreOptions& options)
      : file_(file),
        writer_(options.read_only ? nullptr : std::make_unique<SqliteWriter>(file, options)),
        readers_(
            [file, options] { return open_connection(file, SqliteAccess::kReadOnly, options); },
            options.max_readers),
        cache_(options.cache_bytes),
        commits_([this](const auto& batch) { execute(batch); }, kGroupCommitWait,
                 kGroupCommitBatch) {
    if (options.read_only) {
      readers_.read(require_current_schema);
    } else {
      commits_.run([this] { remove_staged_maps(*writer_->connection); });
    }
  }

  MapInfo create_map(const std::string& name, const LatticeSpec& lattice,
                     const CellForm& form) override {
    validate_map_name(name);
    lattice.validate();
    form.validate();
    MapInfo created;
    write([&](SqliteConnection& c) {
      insert_map(c, name, lattice, form, now());
      created = read_map_row(c, name).info;  // no CELLs yet: no bounds, no sessions
    });
    return created;
  }

  void delete_map(const std::string& name) override {
    write([&](SqliteConnection& c) { remove_map(c, name); });
  }

  void set_georeference(const std::string& map,
                        const std::optional<Georeference>& georeference) override {
    if (georeference) georeference->validate();
    write([&](SqliteConnection& c) { write_georeference(c, map, georeference); });
  }

  void set_form(const std::string& map, const CellForm& form) override {
    form.validate();
    write([&](SqliteConnection& c) { write_form(c, map, form); });
  }

  void put_document(const std::string& map, const std::string& name,
                    const std::string& text) override {
    if (text.size() > kMaxBytes) {
      throw Error(ErrorCode::kTooLarge, "a document of a map is at most " +
                                            std::to_string(kMaxBytes) + " bytes long, not " +
                                            std::to_string(text.size()));
    }
    write([&](SqliteConnection& c) { write_document(c, map, name, text); });
  }

  std::optional<std::string> document(const std::string& map,
                                      const std::string& name) const override {
    return readers_.read([&](SqliteConnection& c) -> std::optional<std::string> {
      Query row(c, "SELECT content FROM document WHERE map = ? AND name = ?",
                read_map_row(c, map).key, name);
      if (!row.next()) return std::nullopt;
      return row.text(0);
    });
  }

  void remove_document(const std::string& map, const std::string& name) override {
    write([&](SqliteConnection& c) {
      Query(c, "DELETE FROM document WHERE map = ? AND name = ?", read_map_row(c, map).key, name)
          .run();
    });
  }

  std::vector<MapInfo> maps() const override {
    auto all = readers_.read([&](SqliteConnection& c) { return read_maps(c, summaries_); });
    std::erase_if(all, [](const MapInfo& info) { return is_staged(info.name); });
    return all;
  }

  MapInfo map(const std::string& name) const override {
    return readers_.read(
        [&](SqliteConnection& c) { return summaries_.complete(c, read_map_row(c, name)); });
  }

  std::string stage_map(const LatticeSpec& lattice) override {
    lattice.validate();
    std::string name;
    write([&](SqliteConnection& c) { name = insert_staged_map(c, lattice, now()); });
    return name;
  }

  void publish_map(const std::string& staged, const std::string& name,
                   const std::optional<Along>& along) override {
    validate_map_name(name);
    if (along) validate(along->update);
    const UpdateFrames frames = along ? frames_of(along->update) : UpdateFrames{};
    write([&](SqliteConnection& c) {
      rename_staged_map(c, staged, name);
      if (along) apply_update(c, along->map, along->update, frames);
    });
  }

  void back_up(const std::filesystem::path& to, const std::stop_token& stop,
               const BackupProgress& progress) const override {
    backup_store(file_, to, stop, progress);
  }

  MapVersion version(const std::string& name) const override {
    return readers_.read([&](SqliteConnection& c) {
      const MapInfo info = read_map_row(c, name).info;
      return MapVersion{info.created, info.revision};
    });
  }

  CommitResult commit(const std::string& map, const MapUpdate& update) override {
    validate(update);
    const UpdateFrames frames = frames_of(update);
    CommitResult result;
    write([&](SqliteConnection& c) { result = apply_update(c, map, update, frames); });
    return result;
  }

  SessionInfo create_session(const std::string& map, const SessionInfo& session) override {
    validate(session);
    write([&](SqliteConnection& c) { insert_session(c, map, session); });
    for (SessionInfo& made : sessions(map)) {
      if (made.name == session.name) return made;
    }
    throw Error(ErrorCode::kNotFound, "map " + map + " was deleted meanwhile");
  }

  std::vector<SessionInfo> sessions(const std::string& map) const override {
    return readers_.read([&](SqliteConnection& c) { return read_sessions(c, map); });
  }

  CellPage cells(const std::string& map, const CellQuery& query) const override {
    validate(query);
    return readers_.read(
        [&](SqliteConnection& c) { return read_cells(c, read_map_row(c, map), query); });
  }

  CellRecord cell(const std::string& map, CellId id) const override {
    return readers_.read([&](SqliteConnection& c) { return required_cell(c, map, id); });
  }

  std::vector<CellRecord> nearest(const std::string& map, const Eigen::Vector3d& position,
                                  std::size_t count) const override {
    validate_position(position);
    if (count > StoreLimits::kMaxPageSize) {
      throw Error(ErrorCode::kInvalidArgument,
                  "count: expected at most " + std::to_string(StoreLimits::kMaxPageSize));
    }
    return readers_.read([&](SqliteConnection& c) {
      return read_nearest(c, read_map_row(c, map), position, count);
    });
  }

  StoredCell stored_cell(const std::string& map, CellId id) const override {
    return readers_.read([&](SqliteConnection& c) {
      const auto kept = find_kept(c, read_map_row(c, map).key, id);
      if (!kept) throw no_cell(map, id);
      StoredCell cell{kept->hash, kept->form, cache_.find(kept->content)};
      if (cell.frame) return cell;
      cell.frame = read_blob(c, kept->content);
      cache_.insert(kept->content, cell.frame);
      return cell;
    });
  }

  std::vector<CellKeeping> keeping(const std::string& map,
                                   const std::optional<std::string>& session) const override {
    return readers_.read(
        [&](SqliteConnection& c) { return read_keeping(c, read_map_row(c, map).key, session); });
  }

  std::optional<CellRecord> last_cell(const std::string& map,
                                      const std::string& session) const override {
    return readers_.read(
        [&](SqliteConnection& c) { return find_last_cell(c, read_map_row(c, map).key, session); });
  }

  PoseGraph pose_graph(const std::string& map, std::optional<Revision> revision) const override {
    return readers_.read([&](SqliteConnection& c) { return read_pose_graph(c, map, revision); });
  }

  MapChanges changes(const std::string& map, Revision since) const override {
    return readers_.read([&](SqliteConnection& c) { return read_changes(c, map, since); });
  }

  std::vector<CellScans> scans(const std::string& map, const std::string& session) const override {
    return readers_.read(
        [&](SqliteConnection& c) { return read_scans(c, read_map_row(c, map).key, session); });
  }

  JobRecord create_job(JobRecord job) override {
    validate(job);
    job.created = job.updated = now();
    write([&](SqliteConnection& c) { job.id = insert_job(c, job); });
    return job;
  }

  void update_job(const JobRecord& job) override {
    validate(job);
    JobRecord stamped = job;
    stamped.updated = now();
    write([&](SqliteConnection& c) { replace_job(c, stamped); });
  }

  JobRecord job(JobId id) const override {
    return readers_.read([&](SqliteConnection& c) { return read_job(c, id); });
  }

  std::vector<JobRecord> jobs(const std::optional<std::string>& map) const override {
    return readers_.read([&](SqliteConnection& c) { return read_jobs(c, map); });
  }

  void check_ready() const override {
    readers_.read([](SqliteConnection& c) { return c.integer("SELECT COUNT(*) FROM map"); });
    if (writer_) commits_.run([] {});
    std::error_code error;
    const auto space = std::filesystem::space(file_, error);
    if (error || space.available < kMinFreeBytes) {
      throw Error(ErrorCode::kIo, "store: less than 32 MiB are free on its disk; free space");
    }
  }

 private:
  /// Compressed before the write, so that writers do it at the same time.
  static UpdateFrames frames_of(const MapUpdate& update) {
    UpdateFrames frames;
    for (const NewCell& cell : update.cells) {
      frames.cells.push_back(frame_of(cell.encoded, cell.coded));
    }
    for (const auto& [id, cell] : update.recoded) {
      frames.recoded.push_back(frame_of(cell.encoded, cell.coded));
    }
    return frames;
  }

  static CellRecord required_cell(SqliteConnection& connection, const std::string& map, CellId id) {
    std::optional<CellRecord> cell = find_cell(connection, read_map_row(connection, map).key, id);
    if (!cell) throw no_cell(map, id);
    return *std::move(cell);
  }

  static Error no_cell(const std::string& map, CellId id) {
    return Error(ErrorCode::kNotFound, "map " + map + " has no CELL " + std::to_string(id.value));
  }

  static Bytes frame_of(const EncodedCell& encoded, const std::optional<CodedCopy>& coded) {
    return zstd_compress(coded ? coded->content.bytes : encoded.bytes);
  }

  /// Returns when what `change(connection)` did is durable; then wakes who waits for changes.
  template <typename Change>
  void write(const Change& change) const {
    if (!writer_) {
      throw Error(ErrorCode::kUnsupported,
                  "store " + file_.string() + " was opened read-only; open it for writing");
    }
    commits_.run([&] { change(*writer_->connection); });
    committed().notify();
  }

  void execute(const std::vector<GroupCommit::Write*>& batch) noexcept;

  const std::filesystem::path file_;
  const std::unique_ptr<SqliteWriter> writer_;  ///< of the head of `commits_`; null where read-only
  mutable SqlitePool readers_;
  mutable BlobCache cache_;
  mutable MapSummaries summaries_;
  mutable GroupCommit commits_;
};

/// One transaction for all, one savepoint for each: a write that fails takes back only its own.
void SqliteStore::execute(const std::vector<GroupCommit::Write*>& batch) noexcept {
  SqliteConnection& connection = *writer_->connection;
  try {
    connection.execute("BEGIN IMMEDIATE");
    for (GroupCommit::Write* const write : batch) {
      connection.execute("SAVEPOINT write");
      try {
        write->work();
      } catch (...) {
        write->failure = std::current_exception();
        // After a full disk, for example, SQLite has rolled back everything itself.
        if (!connection.in_transaction()) throw;
        connection.execute("ROLLBACK TO write");
      }
      connection.execute("RELEASE write");
    }
    connection.execute("COMMIT");
  } catch (...) {
    for (GroupCommit::Write* const write : batch) {
      if (!write->failure) write->failure = std::current_exception();
    }
    try {
      if (connection.in_transaction()) connection.execute("ROLLBACK");
    } catch (...) {
      // The next BEGIN fails then and says so to its callers.
    }
  }
}

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
  return std::make_unique<SqliteStore>(path, options);
}

}  // namespace cellmap
