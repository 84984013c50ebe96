#include "cellmap/store/check_store.hpp"

#include <algorithm>
#include <array>
#include <map>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_schema.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "cellmap/store/staging.hpp"
#include "cellmap/store/store_rules.hpp"

namespace cellmap {
namespace {

constexpr std::array<std::string_view, 8> kNames = {"file",  "content",  "reference", "pose",
                                                    "drive", "revision", "count",     "unused"};

/// Every revision of a map (bound first) that left a trace.
constexpr const char* kTraces =
    "SELECT COUNT(*) FROM (SELECT added AS r FROM cell WHERE map = ?1 "
    "UNION SELECT moved FROM cell WHERE map = ?1 "
    "UNION SELECT revision FROM cell_pose WHERE map = ?1 "
    "UNION SELECT aligned FROM session WHERE map = ?1 "
    "UNION SELECT added FROM pose_constraint WHERE map = ?1 "
    "UNION SELECT removed FROM pose_constraint WHERE map = ?1 "
    "UNION SELECT judged FROM pose_constraint WHERE map = ?1) "
    "WHERE r > ?2 AND r <= ?3";

/// One look at a store, at one revision.
class StoreCheck {
 public:
  StoreCheck(const std::filesystem::path& file, const std::stop_token& stop,
             const StoreProgress& progress)
      : file_(file),
        stop_(stop),
        progress_(progress),
        connection_(file, SqliteAccess::kReadOnly, 5000) {}

  StoreReport run() {
    require_current_schema(connection_);
    report_.schema = sqlite_schema_version();
    connection_.execute("BEGIN");
    check_file();
    try {
      check_rows();
      check_contents();
      check_revisions();
    } catch (const Error& error) {
      // Only of a file that is known to be damaged is it no surprise.
      if (error.code() != ErrorCode::kCorruptData || report_.findings.empty()) throw;
      report_.notes.push_back(std::string("the rest cannot be read: ") + error.what());
    }
    for (const auto& [damage, count] : unlisted_) {
      report_.notes.push_back(std::to_string(count) + " more findings of kind '" +
                              std::string(to_string(damage)) + "'");
    }
    return std::move(report_);
  }

 private:
  void add(StoreDamage damage, const std::string& map, std::optional<CellId> cell,
           const std::string& what) {
    if (++listed_[damage] > StoreReport::kMaxFindings) {
      ++unlisted_[damage];
      return;
    }
    report_.findings.push_back({damage, map, cell, what});
  }

  void check_file() {
    try {
      Query lines(connection_, "PRAGMA integrity_check(100)");
      while (lines.next()) {
        if (lines.text(0) != "ok") add(StoreDamage::kFile, "", {}, lines.text(0));
      }
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kCorruptData) throw;
      add(StoreDamage::kFile, "", {}, error.what());
    }
  }

  void check_rows() {
    {
      Query maps(connection_, "SELECT id, name FROM map");
      while (maps.next()) names_[maps.integer(0)] = maps.text(1);
    }
    report_.maps = names_.size();
    report_.cells = static_cast<std::uint64_t>(connection_.integer("SELECT COUNT(*) FROM cell"));
    for (const StoreRule& rule : store_rules()) {
      throw_if_stopped(stop_);
      Query rows(connection_, rule.find);
      while (rows.next()) {
        std::optional<CellId> cell;
        if (!rows.is_null(1)) cell = CellId{rows.unsigned32(1)};
        const std::string detail = rows.is_null(2) ? "" : ": " + rows.text(2);
        add(rule.damage, rows.is_null(0) ? "" : name_of(rows.integer(0)), cell, rule.what + detail);
      }
    }
    for (const auto& [key, name] : names_) {
      if (is_staged(name)) {
        report_.notes.push_back(
            "a map is being made, or was when the server was killed; the next "
            "start removes what is left of it");
      }
    }
  }

  std::string name_of(std::int64_t key) const {
    const auto name = names_.find(key);
    return name == names_.end() ? "number " + std::to_string(key) : name->second;
  }

  /// Every CELL as readers get it, so that whatever it is kept as has to give what its hash says.
  void check_contents() {
    const auto store = open_sqlite_store(file_, {.cache_bytes = 0, .read_only = true});
    Query kept(connection_, "SELECT COUNT(*), COALESCE(SUM(LENGTH(frame)), 0) FROM blob");
    kept.next();
    report_.contents = kept.unsigned64(0);
    report_.content_bytes = kept.unsigned64(1);
    Query cells(connection_, "SELECT map, id FROM cell ORDER BY map, id");
    for (std::uint64_t done = 0; cells.next();) {
      throw_if_stopped(stop_);
      const std::string name = name_of(cells.integer(0));
      const CellId id{cells.unsigned32(1)};
      try {
        check_content(*store, name, id);
      } catch (const Error& error) {
        // What went since the look began is not missing; what has no map was told already.
        if (error.code() == ErrorCode::kNotFound) continue;
        if (is_io(error.code()) || error.code() == ErrorCode::kUnavailable) throw;
        add(StoreDamage::kContent, name, id, error.what());
      }
      if (progress_) progress_(++done, report_.cells);
    }
  }

  static void check_content(const Store& store, const std::string& map, CellId id) {
    const ContentHash expected = store.cell(map, id).hash;
    const Bytes bytes = zstd_decompress(*store.compressed_cell(map, id), kMaxCellBytes);
    if (verified_hash(bytes) != expected) {
      throw Error(ErrorCode::kCorruptData, "its bytes are those of another CELL");
    }
  }

  /// A revision that only judged constraints leaves none once they are judged anew, so a missing
  /// trace is no damage.
  void check_revisions() {
    Query maps(connection_, "SELECT id, name, revision, oldest FROM map");
    while (maps.next()) {
      const std::int64_t revision = maps.integer(2), oldest = maps.integer(3);
      Query traces(connection_, kTraces, maps.integer(0), oldest, revision);
      traces.next();
      const std::int64_t without = revision - oldest - traces.integer(0);
      if (without > 0) {
        report_.notes.push_back("map " + maps.text(1) + ": " + std::to_string(without) + " of " +
                                std::to_string(revision - oldest) +
                                " revisions left no trace, as those do that only judge loops");
      }
    }
  }

  const std::filesystem::path file_;
  const std::stop_token& stop_;
  const StoreProgress& progress_;
  SqliteConnection connection_;
  StoreReport report_;
  std::map<std::int64_t, std::string> names_;
  std::map<StoreDamage, std::size_t> listed_, unlisted_;
};

}  // namespace

std::string_view to_string(StoreDamage damage) { return kNames[static_cast<std::size_t>(damage)]; }

StoreReport check_store(const std::filesystem::path& file, const std::stop_token& stop,
                        const StoreProgress& progress) {
  if (!std::filesystem::exists(file)) {
    throw Error(ErrorCode::kNotFound, "store " + file.string() + " does not exist");
  }
  return StoreCheck(std::filesystem::weakly_canonical(file), stop, progress).run();
}

}  // namespace cellmap
