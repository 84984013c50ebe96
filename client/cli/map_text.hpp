#pragma once

#include <string>

#include "cellmap/client/resources.hpp"

namespace cellmap::cli {

/// A map's summary for people: counts, bytes a CELL and in all, against the raw points (16 B each)
/// and the 0.4 m-downsampled points (12 B each).
std::string map_text(const MapInfo& map);

/// One line a map.
std::string map_line(const MapInfo& map);
/// One line: name, robot, sensor, CELLs, and whether it is in the map frame.
std::string session_line(const Session& session);

}  // namespace cellmap::cli
