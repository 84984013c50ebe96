#pragma once

#include <string>
#include <vector>

#include "cellmap/store/store.hpp"

namespace cellmap {

/// Every page of the CELLs of one session, in order of the drive. Empty for a session that is not
/// there. Each page is of the revision at which it is read. Throws as `Store::cells`.
std::vector<CellRecord> all_cells_of(const Store& store, const std::string& map,
                                     const std::string& session);

}  // namespace cellmap
