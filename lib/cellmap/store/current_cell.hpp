#pragma once

#include <string>

#include "cellmap/store/store.hpp"

namespace cellmap {

/// A CELL and the revision of its map, of one state of the store.
struct CurrentCell {
  Revision revision = 0;
  CellRecord record;
};

/// A store that reads both at once.
class CurrentCells {
 public:
  virtual ~CurrentCells() = default;
  virtual CurrentCell current_cell(const std::string& map, CellId id) const = 0;
};

/// Throws what `Store::cell` throws. A microsecond for a CELL that was asked for since the last
/// change of a store that one process writes. A store without `CurrentCells` is asked twice, for
/// the revision first, so that the CELL is at least as new.
CurrentCell current_cell(const Store& store, const std::string& map, CellId id);

}  // namespace cellmap
