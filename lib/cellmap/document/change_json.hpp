#pragma once

#include "cellmap/change/diff.hpp"
#include "cellmap/document/json.hpp"

namespace cellmap::document {

/// A place where something changed, as GET /v1/maps/{map}/diff tells it.
Json to_json(const ChangeRegion& region);

}  // namespace cellmap::document
