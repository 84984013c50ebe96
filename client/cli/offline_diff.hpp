#pragma once

#include <stop_token>

#include "cellmap/client/diff.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {

/// What the server does for `diff_sessions`, done here on a store or a mirror; no limit. `threads`
/// 0: all. Throws Error{kNotFound} for a session that is not there, {kConflict} for one that is not
/// aligned, {kInvalidArgument} for twice the same one, {kCancelled}.
MapDiff diff_offline(MapReader& reader, const std::string& map, const DiffRequest& request,
                     int threads, const std::stop_token& stop);

}  // namespace cellmap::cli
