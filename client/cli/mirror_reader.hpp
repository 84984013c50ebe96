#pragma once

#include <filesystem>
#include <memory>

#include "client/cli/map_reader.hpp"

namespace cellmap::cli {

/// Reads the one map of a mirror without its server: the CELLs whose bytes are in the folder, and
/// the whole pose graph. The state is that of this moment, whatever a follower writes later. Scans
/// are not in a mirror: trajectories are Error{kUnsupported}.
std::unique_ptr<MapReader> open_mirror(const std::filesystem::path& folder);

}  // namespace cellmap::cli
