#pragma once

#include <memory>
#include <string>

#include "cellmap/archive/archive_reader.hpp"
#include "client/cli/map_reader.hpp"

namespace cellmap::cli {

/// A file of this machine, or one behind HTTP.
std::unique_ptr<ByteSource> open_bytes(const std::string& file_or_url, const Place& place);

/// Reads the one map of an archive, wherever it lies; nothing is fetched twice but CELLs. CELLs of
/// a compact archive come with the hash of what they are now, their records with that of the CELL
/// that was archived.
std::unique_ptr<MapReader> open_archive_reader(const Place& place);

}  // namespace cellmap::cli
