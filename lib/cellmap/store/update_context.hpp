#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "cellmap/store/sql_connection.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// What an update has to know of the tables before it writes, of all that it names at once. Whoever
/// carries it out keeps this true while it writes.
struct UpdateContext {
  /// The bytes that are kept of a CELL.
  struct Kept {
    ContentHash hash;
    std::uint64_t frame_bytes = 0;
  };
  /// What makes a constraint the same as another one, as the tables have it.
  struct Likeness {
    CellId from, to;
    std::uint32_t kind = 0, origin = 0;
    Bytes T_from_to, information;
    bool operator<(const Likeness& other) const;
  };
  static Likeness likeness(const Constraint& constraint);

  std::map<CellId, CellRecord> cells;
  std::map<CellId, Kept> kept;                                     ///< of those that are recoded
  std::map<std::pair<std::string, std::uint32_t>, CellId> places;  ///< session and sequence
  std::set<std::string> sessions;                                  ///< that have CELLs
  /// Contents that are there at the moment, with their encoded bytes; nobody holds them.
  std::map<ContentHash, std::uint64_t> contents;
  std::map<ConstraintId, Judgement> constraints;  ///< that are not removed
  std::map<Likeness, ConstraintId> alike;         ///< of those to be added
};

/// In few waits, however large the update.
UpdateContext read_update_context(SqlConnection& connection, std::int64_t map,
                                  const MapUpdate& update);

}  // namespace cellmap
