#include "cellmap/store/sql_staging.hpp"

#include <limits>
#include <vector>

#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/sql_writes.hpp"

namespace cellmap {

std::string insert_staged_map(SqlConnection& connection, const LatticeSpec& lattice,
                              Stamp created) {
  // Above every key that is in use, so above the number of every staged map.
  const std::int64_t number = connection.integer("SELECT COALESCE(MAX(id), 0) + 1 FROM map");
  std::string name = "." + std::to_string(number);
  insert_map(connection, name, lattice, CellForm{}, created);
  return name;
}

void rename_staged_map(SqlConnection& connection, const std::string& staged,
                       const std::string& name) {
  {
    Query row(connection, "SELECT 1 FROM map WHERE name = ?", name);
    if (row.next()) {
      throw Error(ErrorCode::kAlreadyExists, "there is a map named '" + name + "' already");
    }
  }
  Query(connection, "UPDATE map SET name = ? WHERE id = ?", name,
        read_map_row(connection, staged).key)
      .run();
}

void remove_staged_maps(SqlConnection& connection, std::optional<Stamp> created_before) {
  std::vector<std::int64_t> maps;
  {
    Query rows(connection, "SELECT id FROM map WHERE name LIKE '.%' AND created < ?",
               created_before.value_or(std::numeric_limits<Stamp>::max()));
    while (rows.next()) maps.push_back(rows.integer(0));
  }
  for (const std::int64_t map : maps) remove_map(connection, map);
}

}  // namespace cellmap
