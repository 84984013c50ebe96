#include "cellmap/store/sql_store.hpp"

#include <chrono>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/store/sql_cells.hpp"
#include "cellmap/store/sql_claims.hpp"
#include "cellmap/store/sql_staging.hpp"
#include "cellmap/store/sql_update.hpp"
#include "cellmap/store/sql_writes.hpp"
#include "cellmap/store/validation.hpp"

namespace cellmap {
namespace {

std::uint64_t this_minute() {
  const auto since_start = std::chrono::steady_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<std::chrono::minutes>(since_start).count());
}

Bytes frame_of(const EncodedCell& encoded, const std::optional<CodedCopy>& coded) {
  return zstd_compress(coded ? coded->content.bytes : encoded.bytes);
}

Error no_cell(const std::string& map, CellId id) {
  return Error(ErrorCode::kNotFound, "map " + map + " has no CELL " + std::to_string(id.value));
}

}  // namespace

Stamp SqlStore::now() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

SqlStore::Database::Database(SqlEngine engine, const Store& store)
    : owner(store),
      name(std::move(engine.name)),
      held(std::move(engine.held)),
      writers(std::move(engine.writer), std::move(engine.open_writer), engine.max_writers,
              engine.is_only_writer ? &known : nullptr),
      claimer(std::move(engine.claimer)),
      readers(std::move(engine.open_reader), engine.max_readers),
      cache(engine.cache_bytes),
      blobs(engine.objects),
      is_only_writer(engine.is_only_writer) {}

SqlStore::SqlStore(SqlEngine engine) {
  const auto staging_limit = engine.staging_limit;
  database_ = std::make_shared<Database>(std::move(engine), *this);
  if (!database_->writers.can_write()) return;
  std::optional<Stamp> created_before;
  if (staging_limit) created_before = now() - std::chrono::nanoseconds(*staging_limit).count();
  change_tables([&](SqlConnection& c) {
    remove_staged_maps(c, created_before);
    if (!staging_limit) void_all_claims(c);
  });
}

SqlStore::SqlStore(std::shared_ptr<Database> database, const JobClaim& claim)
    : database_(std::move(database)), fence_(claim) {}

MapInfo SqlStore::create_map(const std::string& name, const LatticeSpec& lattice,
                             const CellForm& form) {
  validate_map_name(name);
  lattice.validate();
  form.validate();
  MapInfo created;
  change_tables([&](SqlConnection& c) {
    insert_map(c, name, lattice, form, now());
    created = read_map_row(c, name).info;  // no CELLs yet: no bounds, no sessions
  });
  return created;
}

void SqlStore::delete_map(const std::string& name) {
  change_map(name, [](SqlConnection& c, const MapRow& row) { remove_map(c, row.key); });
}

void SqlStore::set_georeference(const std::string& map,
                                const std::optional<Georeference>& georeference) {
  if (georeference) georeference->validate();
  change_map(map, [&](SqlConnection& c, const MapRow& row) {
    write_georeference(c, row.key, georeference);
  });
}

void SqlStore::set_form(const std::string& map, const CellForm& form) {
  form.validate();
  change_map(map, [&](SqlConnection& c, const MapRow& row) { write_form(c, row.key, form); });
}

void SqlStore::put_document(const std::string& map, const std::string& name,
                            const std::string& text) {
  if (text.size() > kMaxBytes) {
    throw Error(ErrorCode::kTooLarge, "a document of a map is at most " +
                                          std::to_string(kMaxBytes) + " bytes long, not " +
                                          std::to_string(text.size()));
  }
  change_map(map,
             [&](SqlConnection& c, const MapRow& row) { write_document(c, row.key, name, text); });
}

std::optional<std::string> SqlStore::document(const std::string& map,
                                              const std::string& name) const {
  return database_->readers.read([&](SqlConnection& c) -> std::optional<std::string> {
    Query row(c, "SELECT content FROM document WHERE map = ? AND name = ?",
              read_map_row(c, map).key, name);
    if (!row.next()) return std::nullopt;
    return row.text(0);
  });
}

void SqlStore::remove_document(const std::string& map, const std::string& name) {
  change_map(map, [&](SqlConnection& c, const MapRow& row) {
    Query(c, "DELETE FROM document WHERE map = ? AND name = ?", row.key, name).run();
  });
}

std::vector<MapInfo> SqlStore::maps() const {
  auto all =
      database_->readers.read([&](SqlConnection& c) { return read_maps(c, database_->summaries); });
  std::erase_if(all, [](const MapInfo& info) { return is_staged(info.name); });
  return all;
}

MapInfo SqlStore::map(const std::string& name) const {
  return database_->readers.read(
      [&](SqlConnection& c) { return database_->summaries.complete(c, read_map_row(c, name)); });
}

std::string SqlStore::stage_map(const LatticeSpec& lattice) {
  lattice.validate();
  std::string name;
  change_tables([&](SqlConnection& c) { name = insert_staged_map(c, lattice, now()); });
  return name;
}

void SqlStore::publish_map(const std::string& staged, const std::string& name,
                           const std::optional<Along>& along) {
  validate_map_name(name);
  if (along) validate(along->update);
  const UpdateFrames frames = along ? frames_of(along->update) : UpdateFrames{};
  change_tables([&](SqlConnection& c) {
    rename_staged_map(c, staged, name);
    if (along) apply_update(c, read_map_row(c, along->map), along->update, frames);
  });
}

MapVersion SqlStore::version(const std::string& name) const {
  return database_->readers.read([&](SqlConnection& c) {
    const MapInfo info = read_map_row(c, name).info;
    return MapVersion{info.created, info.revision};
  });
}

UpdateFrames SqlStore::frames_of(const MapUpdate& update) const {
  UpdateFrames frames;
  for (const NewCell& cell : update.cells) {
    frames.cells.push_back(frame_of(cell.encoded, cell.coded));
  }
  for (const auto& [id, cell] : update.recoded) {
    frames.recoded.push_back(frame_of(cell.encoded, cell.coded));
  }
  frames.are_objects = database_->blobs.are_objects();
  if (!frames.are_objects) return frames;
  std::vector<const Bytes*> all;
  for (const Bytes& frame : frames.cells) all.push_back(&frame);
  for (const Bytes& frame : frames.recoded) all.push_back(&frame);
  database_->blobs.put(all);
  return frames;
}

CommitResult SqlStore::commit(const std::string& map, const MapUpdate& update) {
  validate(update);
  const UpdateFrames frames = frames_of(update);
  CommitResult result;
  change_map(map, [&](SqlConnection& c, const MapRow& row) {
    result = apply_update(c, row, update, frames);
  });
  return result;
}

SessionInfo SqlStore::create_session(const std::string& map, const SessionInfo& session) {
  validate(session);
  change_map(map, [&](SqlConnection& c, const MapRow& row) { insert_session(c, row, session); });
  for (SessionInfo& made : sessions(map)) {
    if (made.name == session.name) return made;
  }
  throw Error(ErrorCode::kNotFound, "map " + map + " was deleted meanwhile");
}

std::vector<SessionInfo> SqlStore::sessions(const std::string& map) const {
  return database_->readers.read([&](SqlConnection& c) { return read_sessions(c, map); });
}

CellPage SqlStore::cells(const std::string& map, const CellQuery& query) const {
  validate(query);
  return database_->readers.read(
      [&](SqlConnection& c) { return read_cells(c, read_map_row(c, map), query); });
}

CellRecord SqlStore::cell(const std::string& map, CellId id) const {
  return database_->readers.read([&](SqlConnection& c) {
    std::optional<CellRecord> cell = find_cell(c, read_map_row(c, map).key, id);
    if (!cell) throw no_cell(map, id);
    return *std::move(cell);
  });
}

std::shared_ptr<const KnownCell> SqlStore::known_cell(const std::string& map, CellId id) const {
  const auto state = database_->is_only_writer ? database_->known.state() : std::nullopt;
  return state ? database_->known.find(*state, map, id) : nullptr;
}

CurrentCell SqlStore::current_cell(const std::string& map, CellId id) const {
  if (const auto known = known_cell(map, id)) return with_bytes(*known);
  const auto state = database_->known.state();  // before it is read
  const auto cell = std::make_shared<const KnownCell>(
      database_->readers.read([&](SqlConnection& c) { return read_cell_of_map(c, map, id); }));
  if (database_->is_only_writer && state) database_->known.insert(*state, map, cell);
  if (!database_->is_only_writer) database_->remembered.insert(this_minute(), map, cell);
  return with_bytes(*cell);
}

CurrentCell SqlStore::with_bytes(const KnownCell& cell) const {
  CurrentCell current{cell.revision, cell.record};
  StoredCell stored{cell.kept.hash, cell.kept.form, database_->cache.find(cell.kept.content)};
  if (stored.frame) current.stored = std::move(stored);
  return current;
}

std::optional<CurrentCell> SqlStore::remembered_cell(const std::string& map, CellId id,
                                                     const std::string& hash) const {
  const auto cell = database_->remembered.find(this_minute(), map, id);
  if (!cell || to_hex(cell->record.hash) != hash) return std::nullopt;
  CurrentCell current = with_bytes(*cell);
  if (!current.stored) return std::nullopt;
  return current;
}

std::vector<CellRecord> SqlStore::nearest(const std::string& map, const Eigen::Vector3d& position,
                                          std::size_t count) const {
  validate_position(position);
  if (count > StoreLimits::kMaxPageSize) {
    throw Error(ErrorCode::kInvalidArgument,
                "count: expected at most " + std::to_string(StoreLimits::kMaxPageSize));
  }
  return database_->readers.read(
      [&](SqlConnection& c) { return read_nearest(c, read_map_row(c, map), position, count); });
}

StoredCell SqlStore::stored_cell(const std::string& map, CellId id) const {
  if (const auto known = known_cell(map, id)) {
    StoredCell cell{known->kept.hash, known->kept.form, database_->cache.find(known->kept.content)};
    if (cell.frame) return cell;
  }
  ContentHash content;
  BlobRow row;
  StoredCell cell = database_->readers.read([&](SqlConnection& c) {
    const KeptRow kept = read_cell_of_map(c, map, id).kept;
    content = kept.content;
    StoredCell read{kept.hash, kept.form, database_->cache.find(content)};
    if (!read.frame) row = read_blob_row(c, content);
    return read;
  });
  if (cell.frame) return cell;
  cell.frame = database_->blobs.frame_of(content, row);
  database_->cache.insert(content, cell.frame);
  return cell;
}

std::vector<CellKeeping> SqlStore::keeping(const std::string& map,
                                           const std::optional<std::string>& session) const {
  return database_->readers.read(
      [&](SqlConnection& c) { return read_keeping(c, read_map_row(c, map).key, session); });
}

std::optional<CellRecord> SqlStore::last_cell(const std::string& map,
                                              const std::string& session) const {
  return database_->readers.read(
      [&](SqlConnection& c) { return find_last_cell(c, read_map_row(c, map).key, session); });
}

PoseGraph SqlStore::pose_graph(const std::string& map, std::optional<Revision> revision) const {
  return database_->readers.read(
      [&](SqlConnection& c) { return read_pose_graph(c, map, revision); });
}

MapChanges SqlStore::changes(const std::string& map, Revision since) const {
  return database_->readers.read([&](SqlConnection& c) { return read_changes(c, map, since); });
}

std::vector<CellScans> SqlStore::scans(const std::string& map, const std::string& session) const {
  return database_->readers.read(
      [&](SqlConnection& c) { return read_scans(c, read_map_row(c, map).key, session); });
}

void SqlStore::check_ready() const {
  database_->readers.read([](SqlConnection& c) { return c.integer("SELECT COUNT(*) FROM map"); });
  if (!database_->writers.can_write()) return;
  database_->blobs.check_ready();
  if (!database_->claimer) return database_->writers.change_anything([](SqlConnection&) {});
  // Not behind the lock of those who write: one that is cut off must not look like all servers.
  change_rows([](SqlConnection& c) { c.execute("UPDATE job SET worker = worker WHERE id = 0"); });
}

void SqlStore::read_tables(const std::function<void(SqlConnection&)>& read) const {
  database_->readers.read([&](SqlConnection& c) { read(c); });
}

void SqlStore::change_tables(const SqlWriters::Work& change) const {
  database_->require_writable();
  database_->writers.change_anything([&](SqlConnection& c) {
    if (fence_) require_claim(c, *fence_);
    change(c);
  });
  database_->owner.committed().notify();
}

void SqlStore::change_map(const std::string& map,
                          const std::function<void(SqlConnection&, const MapRow&)>& change) const {
  database_->require_writable();
  database_->writers.change_map(map, [&](SqlConnection& c) {
    const MapRow row = lock_map_row(c, map);
    if (fence_) require_claim(c, *fence_);
    change(c, row);
  });
  database_->owner.committed().notify();
}

void SqlStore::change_rows(const std::function<void(SqlConnection&)>& change,
                           void (SqlConnection::*begin)()) const {
  if (!database_->claimer) return change_tables(change);
  const std::lock_guard lock(database_->claiming);
  SqlConnection& connection = *database_->claimer;
  try {
    (connection.*begin)();
    change(connection);
    connection.execute("COMMIT");
  } catch (...) {
    SqlWriters::roll_back(connection);
    throw;
  }
}

void SqlStore::Database::require_writable() const {
  if (writers.can_write()) return;
  throw Error(ErrorCode::kUnsupported,
              "store " + name + " was opened read-only; open it for writing");
}

}  // namespace cellmap
