#include "cellmap/store/sql_remove_session.hpp"

#include <algorithm>

#include "cellmap/store/sql_contents.hpp"

namespace cellmap {
namespace {

void subtract_from_sums(SqlConnection& connection, MapRow& map, const std::string& session) {
  MapInfo& info = map.info;
  {
    Query row(
        connection,
        "SELECT COUNT(*), CAST(COALESCE(SUM(planes), 0) AS BIGINT), "
        "CAST(COALESCE(SUM(cell.encoded_bytes), 0) AS BIGINT), "
        "CAST(COALESCE(SUM(COALESCE(frame_bytes, LENGTH(frame))), 0) AS BIGINT), "
        "CAST(COALESCE(SUM(scans), 0) AS BIGINT), "
        "CAST(COALESCE(SUM(raw_points), 0) AS BIGINT), CAST(COALESCE(SUM(voxel_points), 0) AS "
        "BIGINT), "
        "COALESCE(MAX(id), 0) FROM cell JOIN blob ON blob.hash = cell.hash "
        "WHERE map = ? AND session = ?",
        map.key, session);
    row.next();
    std::uint64_t* const sums[] = {&info.cells,        &info.planes, &info.encoded_bytes,
                                   &info.stored_bytes, &info.scans,  &info.raw_points,
                                   &info.voxel_points};
    // CELLs of before version 3 do not say what they count for.
    for (int i = 0; i < 7; ++i) *sums[i] -= std::min(*sums[i], row.unsigned64(i));
    map.next_cell = std::max(map.next_cell, CellId{row.unsigned32(7) + 1});
  }
  Query row(connection,
            "SELECT COUNT(*) FROM pose_constraint AS c WHERE map = ? AND removed IS NULL AND "
            "EXISTS (SELECT 1 FROM cell WHERE cell.map = c.map AND cell.session = ? "
            "AND cell.id IN (c.from_cell, c.to_cell))",
            map.key, session);
  row.next();
  info.constraints -= std::min(info.constraints, row.unsigned64(0));
}

}  // namespace

std::set<ContentHash> remove_session(SqlConnection& connection, MapRow& map,
                                     const std::string& name) {
  {
    Query row(connection, "SELECT 1 FROM session WHERE map = ? AND name = ?", map.key, name);
    if (!row.next()) {
      throw Error(ErrorCode::kNotFound, "map " + map.info.name + " has no session '" + name + "'");
    }
  }
  subtract_from_sums(connection, map, name);
  constexpr const char* kOfSession = "(SELECT id FROM cell WHERE map = ? AND session = ?)";
  for (const char* const end : {"from_cell", "to_cell"}) {
    Query(connection,
          std::string("DELETE FROM pose_constraint WHERE map = ? AND ") + end + " IN " + kOfSession,
          map.key, map.key, name)
        .run();
  }
  for (const char* const table : {"cell_scans", "cell_pose", "cell_description"}) {
    Query(connection,
          std::string("DELETE FROM ") + table + " WHERE map = ? AND cell IN " + kOfSession, map.key,
          map.key, name)
        .run();
  }
  std::set<ContentHash> contents = kept_contents(connection, map.key, name);
  Query(connection, "DELETE FROM cell WHERE map = ? AND session = ?", map.key, name).run();
  Query(connection, "DELETE FROM session WHERE map = ? AND name = ?", map.key, name).run();
  return contents;
}

}  // namespace cellmap
