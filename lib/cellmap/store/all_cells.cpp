#include "cellmap/store/all_cells.hpp"

#include <algorithm>

namespace cellmap {

std::vector<CellRecord> all_cells_of(const Store& store, const std::string& map,
                                     const std::string& session) {
  std::vector<CellRecord> cells;
  CellQuery query;
  query.session = session;
  query.limit = 10'000;
  do {
    const CellPage page = store.cells(map, query);
    cells.insert(cells.end(), page.cells.begin(), page.cells.end());
    query.cursor = page.next_cursor;
  } while (!query.cursor.empty());
  std::ranges::sort(cells, {}, &CellRecord::sequence);
  return cells;
}

}  // namespace cellmap
