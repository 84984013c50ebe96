#pragma once

#include "cellmap/client/diff.hpp"
#include "cellmap/client/json.hpp"

namespace cellmap::client {

Json to_json(const MapDiff& diff, bool patches);  ///< as the API has it
/// Throws Error{kCorruptData} naming what is missing or of the wrong type.
MapDiff map_diff_from_json(const Json& json);

}  // namespace cellmap::client
