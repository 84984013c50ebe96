#pragma once

#include <optional>
#include <string>

#include "cellmap/client/resources.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap::cli {

/// What the server does for a scan, done here on a store: describes every CELL, searches,
/// registers. Decodes the whole map once (about a millisecond a CELL). `threads` 0: all.
Relocalisation relocalise_in_store(const Store& store, const std::string& map,
                                   const PointCloud& scan, const std::optional<PosePrior>& prior,
                                   int threads);

}  // namespace cellmap::cli
