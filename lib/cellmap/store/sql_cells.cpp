#include "cellmap/store/sql_cells.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <span>

#include "cellmap/store/page_cursor.hpp"
#include "cellmap/store/row_codec.hpp"
#include "cellmap/store/sql_schema.hpp"

namespace cellmap {
namespace {

/// As `cell_from_row` reads them.
constexpr const char* kCellColumns =
    "cell.id, COALESCE(identity, hash), session, sequence, cell.planes, cell.encoded_bytes, "
    "CASE WHEN added > replaced THEN added ELSE replaced END, moved, x, y, z, rotation";

std::string select_cell(const char* condition) {
  return std::string("SELECT ") + kCellColumns + " FROM cell " + condition;
}

CellRecord cell_from_row(const Query& row) {
  CellRecord cell;
  cell.id.value = row.unsigned32(0);
  cell.hash = hash_from(row.bytes(1));
  cell.session = row.text(2);
  cell.sequence = row.unsigned32(3);
  cell.planes = row.unsigned32(4);
  cell.encoded_bytes = row.unsigned64(5);
  cell.added = row.unsigned64(6);
  cell.moved = row.unsigned64(7);
  cell.T_map_cell = pose_from_row(row, 8);
  return cell;
}

/// Columns of the grid that hold a CELL, so that a huge box costs no more than the map's own
/// extent.
struct GridExtent {
  std::int64_t min_x, max_x;
};

std::optional<GridExtent> grid_extent(SqlConnection& connection, std::int64_t map) {
  // Two statements, since SQLite only answers a lone MIN or MAX from the end of the index.
  Query least(connection, "SELECT MIN(gx) FROM cell WHERE map = ?", map);
  if (!least.next() || least.is_null(0)) return std::nullopt;
  Query most(connection, "SELECT MAX(gx) FROM cell WHERE map = ?", map);
  most.next();
  return GridExtent{least.integer(0), most.integer(0)};
}

/// Where a CELL is, without the rest of its row: all from the index.
struct PlacedCell {
  CellId id;
  Eigen::Vector3d position;
};

std::vector<PlacedCell> cells_in_box(SqlConnection& connection, std::int64_t map,
                                     const Eigen::AlignedBox3d& box) {
  std::vector<PlacedCell> cells;
  const auto extent = grid_extent(connection, map);
  if (!extent) return cells;
  // One index range for every grid column; a plain range over gx would read whole columns.
  Query rows(connection,
             "WITH RECURSIVE grid_column(gx) AS (SELECT ? AS gx UNION ALL "
             "SELECT gx + 1 FROM grid_column WHERE gx < ?) "
             "SELECT cell.id, cell.x, cell.y, cell.z FROM grid_column CROSS JOIN cell "
             "WHERE cell.map = ? AND cell.gx = grid_column.gx AND cell.gy BETWEEN ? AND ?",
             std::max(extent->min_x, grid_key(box.min().x())),
             std::min(extent->max_x, grid_key(box.max().x())), map, grid_key(box.min().y()),
             grid_key(box.max().y()));
  while (rows.next()) {
    const PlacedCell cell{{rows.unsigned32(0)}, {rows.real(1), rows.real(2), rows.real(3)}};
    if (box.contains(cell.position)) cells.push_back(cell);
  }
  return cells;
}

Eigen::AlignedBox3d box_around(const Eigen::Vector3d& position, double radius_m) {
  // A hair wider, so that rounding cannot lose a CELL at the very edge; the distance decides.
  const Eigen::Vector3d half = Eigen::Vector3d::Constant(radius_m * (1 + 1e-12) + 1e-6);
  return {position - half, position + half};
}

/// Sort keys of the CELLs within a radius, nearest first, lower id first on a tie.
std::vector<PageCursor> keys_within(SqlConnection& connection, std::int64_t map,
                                    const Eigen::Vector3d& position, double radius_m,
                                    const std::optional<Eigen::AlignedBox3d>& box) {
  std::vector<PageCursor> keys;
  Eigen::AlignedBox3d searched = box_around(position, radius_m);
  if (box) searched = searched.intersection(*box);
  if (searched.isEmpty()) return keys;
  for (const PlacedCell& cell : cells_in_box(connection, map, searched)) {
    const double squared = (cell.position - position).squaredNorm();
    if (squared <= radius_m * radius_m) keys.push_back({squared, cell.id});
  }
  std::sort(keys.begin(), keys.end());
  return keys;
}

std::vector<PageCursor> keys_of(SqlConnection& connection, std::int64_t map,
                                const CellQuery& query) {
  if (query.near) return keys_within(connection, map, *query.near, query.radius_m, query.box);
  std::vector<PageCursor> keys;
  for (const PlacedCell& cell : cells_in_box(connection, map, *query.box)) {
    keys.push_back({0, cell.id});
  }
  std::sort(keys.begin(), keys.end());
  return keys;
}

std::set<std::string> unaligned_sessions(SqlConnection& connection, std::int64_t map) {
  std::set<std::string> names;
  Query rows(connection, "SELECT name FROM session WHERE map = ? AND aligned IS NULL", map);
  while (rows.next()) names.insert(rows.text(0));
  return names;
}

/// How many CELLs are asked for at once: the database may be far away.
constexpr std::size_t kAtOnce = 64;

std::string select_some_cells() {
  std::string sql = select_cell("WHERE map = ? AND id IN (?");
  for (std::size_t i = 1; i < kAtOnce; ++i) sql += ", ?";
  return sql + ")";
}

/// At most `kAtOnce` CELLs that an index names, in the order of their keys.
std::vector<CellRecord> existing_cells(SqlConnection& connection, std::int64_t map,
                                       std::span<const PageCursor> keys) {
  std::map<CellId, CellRecord> found;
  Query rows(connection, select_some_cells(), map);
  for (std::size_t i = 0; i < kAtOnce; ++i) {
    rows.bind(i < keys.size() ? static_cast<std::int64_t>(keys[i].id.value) : -1);
  }
  while (rows.next()) {
    CellRecord cell = cell_from_row(rows);
    found.emplace(cell.id, std::move(cell));
  }
  std::vector<CellRecord> cells;
  for (const PageCursor& key : keys) {
    const auto cell = found.find(key.id);
    if (cell == found.end()) {
      throw Error(ErrorCode::kCorruptData,
                  "store: an index names a CELL that is not there; restore the file from a backup");
    }
    cells.push_back(std::move(cell->second));
  }
  return cells;
}

/// Up to limit + 1 CELLs behind the cursor: one more than the page tells that another follows.
std::vector<CellRecord> cells_by_place(SqlConnection& connection, std::int64_t map,
                                       const CellQuery& query,
                                       const std::optional<PageCursor>& after) {
  const std::vector<PageCursor> keys = keys_of(connection, map, query);
  const auto first = after ? std::upper_bound(keys.begin(), keys.end(), *after) : keys.begin();
  std::span<const PageCursor> left(first, keys.end());
  const std::set<std::string> unaligned = unaligned_sessions(connection, map);
  const auto is_asked_for = [&](const CellRecord& cell) {
    if (cell.moved <= query.since) return false;
    return query.session ? cell.session == *query.session : !unaligned.contains(cell.session);
  };
  std::vector<CellRecord> cells;
  while (!left.empty() && cells.size() <= query.limit) {
    const auto some = left.first(std::min({left.size(), kAtOnce, query.limit + 1}));
    left = left.subspan(some.size());
    for (CellRecord& cell : existing_cells(connection, map, some)) {
      if (is_asked_for(cell)) cells.push_back(std::move(cell));
    }
  }
  cells.resize(std::min(cells.size(), query.limit + 1));
  return cells;
}

std::vector<CellRecord> cells_by_id(SqlConnection& connection, std::int64_t map,
                                    const CellQuery& query,
                                    const std::optional<PageCursor>& after) {
  const std::int64_t last = after ? static_cast<std::int64_t>(after->id.value) : -1;
  Query rows(connection,
             select_cell("WHERE map = ? AND id > ? AND moved > ? "
                         "AND session = COALESCE(?, session) ORDER BY id LIMIT ?"),
             map, last, query.since, query.session, query.limit + 1);
  std::vector<CellRecord> cells;
  while (rows.next()) cells.push_back(cell_from_row(rows));
  return cells;
}

PageCursor cursor_at(const CellRecord& cell, const CellQuery& query) {
  if (!query.near) return {0, cell.id};
  return {(cell.T_map_cell.translation() - *query.near).squaredNorm(), cell.id};
}

}  // namespace

Pose pose_from_row(const Query& row, int first) {
  const Eigen::Vector3d position(row.real(first), row.real(first + 1), row.real(first + 2));
  return pose_from_columns(position, row.bytes(first + 3));
}

ContentHash hash_from(std::span<const std::byte> bytes) {
  ContentHash hash;
  if (bytes.size() != hash.bytes.size()) {
    throw Error(ErrorCode::kCorruptData,
                "store: a content hash is damaged; restore the file from a backup");
  }
  std::transform(bytes.begin(), bytes.end(), hash.bytes.begin(),
                 [](std::byte b) { return std::to_integer<std::uint8_t>(b); });
  return hash;
}

CellForm form_from_row(const Query& row, int first) {
  try {
    CellForm form{static_cast<KeptEncoding>(row.unsigned32(first)), row.unsigned32(first + 1)};
    if (row.unsigned32(first) < 1 || row.unsigned32(first) > 3) {
      throw Error(ErrorCode::kInvalidArgument, "no such encoding");
    }
    form.validate();
    return form;
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kInvalidArgument) throw;
    throw Error(ErrorCode::kCorruptData,
                "store: the form of a map or CELL is damaged; restore the file from a backup");
  }
}

std::optional<CellRecord> find_cell(SqlConnection& connection, std::int64_t map, CellId id) {
  std::optional<CellRecord> cell;
  Questions question;
  ask_cell(question, map, id, [&](CellRecord found) { cell = std::move(found); });
  question.ask(connection);
  return cell;
}

void ask_cell(Questions& questions, std::int64_t map, CellId id,
              std::function<void(CellRecord)> found) {
  questions.add(
      select_cell("WHERE map = ? AND id = ?"),
      [found = std::move(found)](Query& row) {
        if (row.next()) found(cell_from_row(row));
      },
      map, id.value);
}

void ask_cell(Questions& questions, std::int64_t map, const std::string& session,
              std::uint32_t sequence, std::function<void(CellRecord)> found) {
  questions.add(
      select_cell("WHERE map = ? AND session = ? AND sequence = ?"),
      [found = std::move(found)](Query& row) {
        if (row.next()) found(cell_from_row(row));
      },
      map, session, sequence);
}

std::optional<CellRecord> find_last_cell(SqlConnection& connection, std::int64_t map,
                                         const std::string& session) {
  Query row(connection, select_cell("WHERE map = ? AND session = ? ORDER BY sequence DESC LIMIT 1"),
            map, session);
  if (!row.next()) return std::nullopt;
  return cell_from_row(row);
}

std::string order_of_changes(Revision since) { return since == 0 ? "ORDER BY id" : "ORDER BY +id"; }

std::vector<CellRecord> cells_changed_since(SqlConnection& connection, std::int64_t map,
                                            Revision since) {
  Query rows(connection, select_cell("WHERE map = ? AND moved > ? ") + order_of_changes(since), map,
             since);
  std::vector<CellRecord> cells;
  while (rows.next()) cells.push_back(cell_from_row(rows));
  return cells;
}

CellPage read_cells(SqlConnection& connection, const MapRow& map, const CellQuery& query) {
  const std::optional<PageCursor> after = page_cursor(map.info.name, query);
  CellPage page;
  page.revision = map.info.revision;
  if (query.since >= map.info.revision) return page;
  page.cells = query.near || query.box ? cells_by_place(connection, map.key, query, after)
                                       : cells_by_id(connection, map.key, query, after);
  if (page.cells.size() > query.limit) {
    page.cells.resize(query.limit);
    page.next_cursor = to_text(cursor_at(page.cells.back(), query), map.info.name, query);
  }
  return page;
}

std::vector<CellRecord> read_nearest(SqlConnection& connection, const MapRow& map,
                                     const Eigen::Vector3d& position, std::size_t count) {
  count = std::min<std::size_t>(count, map.info.cells);
  std::vector<PageCursor> keys;
  // Circles of twice the size each time; all CELLs are within the last one that can be needed.
  for (double radius_m = kGridSizeM; keys.size() < count; radius_m *= 2) {
    keys = keys_within(connection, map.key, position, radius_m, std::nullopt);
    if (radius_m > 1e8) break;
  }
  keys.resize(std::min(keys.size(), count));
  std::vector<CellRecord> cells;
  for (std::span<const PageCursor> left = keys; !left.empty();) {
    const auto some = left.first(std::min(left.size(), kAtOnce));
    left = left.subspan(some.size());
    std::ranges::move(existing_cells(connection, map.key, some), std::back_inserter(cells));
  }
  return cells;
}

CellOfMap read_cell_of_map(SqlConnection& connection, const std::string& map, CellId id) {
  Query row(connection,
            std::string("SELECT ") + kCellColumns +
                ", hash, cell.encoding, cell.bound_um, map.revision FROM map LEFT JOIN cell ON "
                "cell.map = map.id AND cell.id = ? WHERE map.name = ?",
            id.value, map);
  if (!row.next()) throw no_map(map);
  if (row.is_null(0)) {
    throw Error(ErrorCode::kNotFound, "map " + map + " has no CELL " + std::to_string(id.value));
  }
  const CellRecord record = cell_from_row(row);
  return {
      row.unsigned64(15), record, {hash_from(row.bytes(12)), record.hash, form_from_row(row, 13)}};
}

std::vector<CellKeeping> read_keeping(SqlConnection& connection, std::int64_t map,
                                      const std::optional<std::string>& session) {
  Query rows(connection,
             "SELECT id, COALESCE(identity, hash), COALESCE(source, identity, hash), encoding, "
             "bound_um FROM cell WHERE map = ? AND session = COALESCE(?, session) ORDER BY id",
             map, session);
  std::vector<CellKeeping> keeping;
  while (rows.next()) {
    keeping.push_back({CellId{rows.unsigned32(0)}, hash_from(rows.bytes(1)),
                       hash_from(rows.bytes(2)), form_from_row(rows, 3)});
  }
  return keeping;
}

std::vector<CellScans> read_scans(SqlConnection& connection, std::int64_t map,
                                  const std::string& session) {
  Query rows(connection,
             "SELECT cell.id, cell_scans.T_odom_cell, cell_scans.scans, raw_points, voxel_points "
             "FROM cell "
             "JOIN cell_scans ON cell_scans.map = cell.map AND cell_scans.cell = cell.id "
             "WHERE cell.map = ? AND cell.session = ? ORDER BY cell.sequence",
             map, session);
  std::vector<CellScans> stretches;
  while (rows.next()) {
    stretches.push_back({CellId{rows.unsigned32(0)}, pose_from_bytes(rows.bytes(1)),
                         scans_from_bytes(rows.bytes(2)), rows.unsigned64(3), rows.unsigned64(4)});
  }
  return stretches;
}

}  // namespace cellmap
