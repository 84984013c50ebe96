#include <algorithm>
#include <map>
#include <set>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/check_store.hpp"
#include "cellmap/store/row_codec.hpp"
#include "cellmap/store/sqlite_connection.hpp"
#include "cellmap/store/sqlite_schema.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "cellmap/store/store_file.hpp"
#include "cellmap/store/store_rules.hpp"

namespace cellmap {
namespace {

std::string name_of(const StoreFinding& finding) {
  return "CELL " + std::to_string(finding.cell->value) + " of map " + finding.map;
}

/// One repair, in one transaction that is taken back unless it is committed.
class Repair {
 public:
  explicit Repair(const std::filesystem::path& file)
      : file_(file), lock_(file), connection_(file, SqliteAccess::kReadWrite, 5000) {
    require_current_schema(connection_);
  }

  StoreRepair run(const std::stop_token& stop) {
    const StoreReport found = check_store(file_, stop);
    read_drives(found);
    connection_.execute("PRAGMA synchronous = FULL");
    connection_.execute("BEGIN IMMEDIATE");
    try {
      mend_indices(found);
      remove_cells(found);
      insert_drives();
      for (const StoreRule& rule : store_rules()) mend(rule);
      require_sound_file();
      connection_.execute("COMMIT");
    } catch (...) {
      if (connection_.in_transaction()) connection_.execute("ROLLBACK");
      throw;
    }
    return std::move(result_);
  }

 private:
  /// Before anything is changed, since the store reads through a connection of its own.
  void read_drives(const StoreReport& found) {
    const auto store = open_sqlite_store(file_, {.cache_bytes = 0, .read_only = true});
    for (const StoreFinding& finding : found.findings) {
      if (finding.damage == StoreDamage::kContent && finding.cell) damaged_.insert(key(finding));
    }
    for (const StoreFinding& finding : found.findings) {
      const bool has_no_scans =
          finding.damage == StoreDamage::kDrive && finding.cell && !damaged_.contains(key(finding));
      if (!has_no_scans || drives_.contains(key(finding))) continue;
      const Cell cell = decode_stored_cell(*store->compressed_cell(finding.map, *finding.cell));
      drives_[key(finding)] = pose_to_bytes(cell.T_odom_cell);
    }
  }

  static std::pair<std::string, CellId> key(const StoreFinding& finding) {
    return {finding.map, *finding.cell};
  }

  void mend_indices(const StoreReport& found) {
    const auto is_of_file = [](const StoreFinding& f) { return f.damage == StoreDamage::kFile; };
    if (std::ranges::none_of(found.findings, is_of_file)) return;
    connection_.execute("REINDEX");
    result_.done.push_back("made the indices anew");
  }

  void require_sound_file() {
    Query lines(connection_, "PRAGMA integrity_check(1)");
    lines.next();
    if (lines.text(0) == "ok") return;
    throw Error(ErrorCode::kCorruptData, "store " + file_.string() +
                                             " cannot be repaired, its tables are damaged (" +
                                             lines.text(0) + "); restore a backup");
  }

  void remove_cells(const StoreReport& found) {
    std::set<std::string> maps;
    for (const StoreFinding& finding : found.findings) {
      if (finding.damage != StoreDamage::kContent || !finding.cell) continue;
      maps.insert(finding.map);
      remove_cell(finding);
    }
    for (const std::string& map : maps) {
      Query(connection_,
            "UPDATE map SET revision = revision + 1, oldest = revision + 1 WHERE name = ?", map)
          .run();
      result_.lost.push_back("the revisions of map " + map + " from before this repair");
    }
  }

  void remove_cell(const StoreFinding& finding) {
    const std::uint32_t id = finding.cell->value;
    constexpr const char* kMap = "map = (SELECT id FROM map WHERE name = ?)";
    std::int64_t constraints = 0;
    for (const char* const end : {"from_cell", "to_cell"}) {
      Query(connection_,
            std::string("DELETE FROM pose_constraint WHERE ") + kMap + " AND " + end + " = ?",
            finding.map, id)
          .run();
      constraints += connection_.integer("SELECT changes()");
    }
    for (const char* const table : {"cell_scans", "cell_pose", "cell_description"}) {
      Query(connection_, std::string("DELETE FROM ") + table + " WHERE " + kMap + " AND cell = ?",
            finding.map, id)
          .run();
    }
    Query(connection_, std::string("DELETE FROM cell WHERE ") + kMap + " AND id = ?", finding.map,
          id)
        .run();
    Query(connection_, "UPDATE map SET next_cell = MAX(next_cell, ? + 1) WHERE name = ?", id,
          finding.map)
        .run();
    result_.lost.push_back(name_of(finding) + " with its poses and " + std::to_string(constraints) +
                           " constraints: " + finding.what);
  }

  void insert_drives() {
    for (const auto& [cell, T_odom_cell] : drives_) {
      Query(connection_,
            "INSERT INTO cell_scans (map, cell, T_odom_cell, scans) SELECT map, id, ?, ? FROM cell "
            "WHERE map = (SELECT id FROM map WHERE name = ?) AND id = ? "
            "ON CONFLICT (map, cell) DO NOTHING",
            T_odom_cell, scans_to_bytes({}), cell.first, cell.second.value)
          .run();
      if (connection_.integer("SELECT changes()") == 0) continue;
      result_.lost.push_back("the scans of CELL " + std::to_string(cell.second.value) + " of map " +
                             cell.first);
    }
  }

  void mend(const StoreRule& rule) {
    if (rule.mend.empty()) return;
    connection_.execute(rule.mend.c_str());
    const std::int64_t rows = connection_.integer("SELECT changes()");
    if (rows == 0) return;
    if (rule.lost) {
      result_.lost.push_back(std::to_string(rows) + " " + rule.lost);
    } else {
      result_.done.push_back(std::to_string(rows) + " times: " + rule.what);
    }
  }

  const std::filesystem::path file_;
  const WriterLock lock_;
  SqliteConnection connection_;
  StoreRepair result_;
  std::set<std::pair<std::string, CellId>> damaged_;
  std::map<std::pair<std::string, CellId>, Bytes> drives_;  ///< T_odom_cell of CELLs without scans
};

}  // namespace

StoreRepair repair_store(const std::filesystem::path& file, const std::stop_token& stop) {
  if (!std::filesystem::exists(file)) {
    throw Error(ErrorCode::kNotFound, "store " + file.string() + " does not exist");
  }
  return Repair(std::filesystem::weakly_canonical(file)).run(stop);
}

}  // namespace cellmap
