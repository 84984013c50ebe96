#pragma once

#include <optional>
#include <string>

#include "cellmap/store/store.hpp"

namespace cellmap {

/// A CELL and the revision of its map, of one state of the store.
struct CurrentCell {
  Revision revision = 0;
  CellRecord record;
  std::optional<StoredCell> stored = {};  ///< of the same state, where its bytes are in memory
};

/// A store that reads both at once.
class CurrentCells {
 public:
  virtual ~CurrentCells() = default;
  virtual CurrentCell current_cell(const std::string& map, CellId id) const = 0;
  virtual std::optional<CurrentCell> remembered_cell(const std::string& map, CellId id,
                                                     const std::string& hash) const = 0;
};

/// Throws what `Store::cell` throws. One wait for a database that is far away; a microsecond for a
/// CELL that was asked for since the last change of a store that one process writes. A store
/// without `CurrentCells` is asked twice, for the revision first, so that the CELL is at least as
/// new.
CurrentCell current_cell(const Store& store, const std::string& map, CellId id);

/// What an address means that names a CELL's content: the CELL as it was when it was last read,
/// with its bytes, where a store that many processes write has those of this hash (hexadecimal) in
/// memory; nullopt is no error. The database is not asked, so that it may be slow or far: pose
/// and revision are up to a minute old, and so is that the CELL is there, as with any cache along
/// the way.
std::optional<CurrentCell> remembered_cell(const Store& store, const std::string& map, CellId id,
                                           const std::string& hash);

}  // namespace cellmap
