#pragma once

#include <optional>
#include <string>

#include "cellmap/client/resources.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {

/// What the server does for a query, done here on a store or a mirror: describes every CELL that
/// `reader` has, searches, registers. Decodes them once (about a millisecond a CELL). `threads` 0:
/// all.
Relocalisation relocalise_offline(MapReader& reader, const std::string& map,
                                  const RelocalisationQuery& query, int threads);

}  // namespace cellmap::cli
