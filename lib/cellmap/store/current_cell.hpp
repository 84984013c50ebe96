#pragma once

#include <optional>
#include <string>

#include "cellmap/store/store.hpp"

namespace cellmap {

/// A CELL and the revision of its map, of one state of the store.
struct CurrentCell {
  Revision revision = 0;
  CellRecord record;
};

/// What an address means that names a CELL's content.
struct RememberedCell {
  CurrentCell cell;  ///< as it was when it was last read
  StoredCell stored;
};

/// A store that reads both at once.
class CurrentCells {
 public:
  virtual ~CurrentCells() = default;
  virtual CurrentCell current_cell(const std::string& map, CellId id) const = 0;
  virtual std::optional<RememberedCell> remembered_cell(const std::string& map, CellId id,
                                                        const std::string& hash) const = 0;
};

/// Throws what `Store::cell` throws. A microsecond for a CELL that was asked for since the last
/// change of a store that one process writes. A store without `CurrentCells` is asked twice, for
/// the revision first, so that the CELL is at least as new.
CurrentCell current_cell(const Store& store, const std::string& map, CellId id);

/// The content of this hash (hexadecimal) of a CELL, where a store that many processes write has it
/// in memory; nullopt is no error. The database is not asked, so that it may be slow or far: pose
/// and revision are up to a minute old, and so is that the CELL is there, as with any cache along
/// the way.
std::optional<RememberedCell> remembered_cell(const Store& store, const std::string& map, CellId id,
                                              const std::string& hash);

}  // namespace cellmap
