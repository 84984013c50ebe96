#pragma once

#include <optional>
#include <string>

#include "cellmap/store/store.hpp"

namespace cellmap {

/// Where a page of CELLs ended: the sort key of its last CELL. The next page begins behind it, so
/// writes between two pages neither repeat nor skip a CELL that they do not move.
struct PageCursor {
  double squared_distance = 0;  ///< m^2 to CellQuery::near; 0 without
  CellId id;
  auto operator<=>(const PageCursor&) const = default;
};

/// Opaque text that only fits the same query (limit apart) on the same map.
std::string to_text(const PageCursor& cursor, const std::string& map, const CellQuery& query);

/// The cursor in `query.cursor`, or nullopt for the first page. Throws Error{kInvalidArgument} for
/// anything that `to_text` did not make for this query.
std::optional<PageCursor> page_cursor(const std::string& map, const CellQuery& query);

}  // namespace cellmap
