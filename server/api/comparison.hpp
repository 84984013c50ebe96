#pragma once

#include "server/api/api.hpp"

namespace cellmap::server {

/// /v1/maps/{map}/comparison.
void add_comparison_routes(Router& router, Services& services);

}  // namespace cellmap::server
