#pragma once

#include <vector>

#include "cellmap/store/store.hpp"

namespace cellmap::cli {

/// What a query finds among records that are all in memory, by id, as a page. Throws
/// Error{kInvalidArgument} for a cursor that is not one of these pages.
CellPage page_of(std::vector<CellRecord> records, Revision revision, const CellQuery& query);

}  // namespace cellmap::cli
