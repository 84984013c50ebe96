#pragma once

#include <functional>

#include "cellmap/store/blob_cache.hpp"
#include "cellmap/store/sql_connection.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

// What the SQL engines read of CELLs. Each function expects to run inside one transaction, so
// that all its statements see one revision. `map` is the key of a MapRow.

/// Columns x, y, z, rotation from `first` on.
Pose pose_from_row(const Query& row, int first);

ContentHash hash_from(std::span<const std::byte> bytes);
/// Columns encoding, bound_um from `first` on.
CellForm form_from_row(const Query& row, int first);

/// Which bytes are kept of a CELL.
struct KeptRow {
  ContentHash content;  ///< of the blob
  ContentHash hash;     ///< of the CELL
  CellForm form;
};
/// What the rows of a CELL and its map say.
struct CellOfMap {
  Revision revision = 0;  ///< of the map
  CellRecord record;
  KeptRow kept;
};
/// In one statement, for who is far away. Error{kNotFound} where there is no such map or CELL.
CellOfMap read_cell_of_map(SqlConnection& connection, const std::string& map, CellId id);
/// Of a map, or one session of it.
std::vector<CellKeeping> read_keeping(SqlConnection& connection, std::int64_t map,
                                      const std::optional<std::string>& session);

std::optional<CellRecord> find_cell(SqlConnection& connection, std::int64_t map, CellId id);
/// As questions; `found` is called where there is such a CELL.
void ask_cell(Questions& questions, std::int64_t map, CellId id,
              std::function<void(CellRecord)> found);
void ask_cell(Questions& questions, std::int64_t map, const std::string& session,
              std::uint32_t sequence, std::function<void(CellRecord)> found);
/// The ORDER BY of what changed after a revision: by id, but beside revision 0 after an index over
/// revisions was used. SQLite, which keeps no statistics, would rather read a whole map in order
/// than sort the little that changed.
std::string order_of_changes(Revision since);
/// CELLs that were added or moved after a revision, in order of id.
std::vector<CellRecord> cells_changed_since(SqlConnection& connection, std::int64_t map,
                                            Revision since);
std::optional<CellRecord> find_last_cell(SqlConnection& connection, std::int64_t map,
                                         const std::string& session);

CellPage read_cells(SqlConnection& connection, const MapRow& map, const CellQuery& query);
std::vector<CellRecord> read_nearest(SqlConnection& connection, const MapRow& map,
                                     const Eigen::Vector3d& position, std::size_t count);

std::vector<CellScans> read_scans(SqlConnection& connection, std::int64_t map,
                                  const std::string& session);

}  // namespace cellmap
