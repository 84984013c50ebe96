#pragma once

#include "server/api/router.hpp"

namespace cellmap::server {

/// Compresses a finished body with zstd where the request's Accept-Encoding allows it and it
/// becomes shorter; says so, and that the answer varies with it. Bodies below 256 KiB at the level
/// for thin links (3 % shorter, some milliseconds), longer ones at zstd's own default.
void compress_if_accepted(const Call& call, Response& response);

}  // namespace cellmap::server
