#include "cellmap/store/current_cell.hpp"

namespace cellmap {

CurrentCell current_cell(const Store& store, const std::string& map, CellId id) {
  if (const auto* cells = dynamic_cast<const CurrentCells*>(&store)) {
    return cells->current_cell(map, id);
  }
  const Revision revision = store.version(map).revision;
  return {revision, store.cell(map, id)};
}

std::optional<CurrentCell> remembered_cell(const Store& store, const std::string& map, CellId id,
                                           const std::string& hash) {
  const auto* const cells = dynamic_cast<const CurrentCells*>(&store);
  return cells ? cells->remembered_cell(map, id, hash) : std::nullopt;
}

}  // namespace cellmap
