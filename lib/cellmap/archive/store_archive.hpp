#pragma once

#include <stop_token>
#include <string>

#include "cellmap/archive/archive_reader.hpp"
#include "cellmap/archive/archive_writer.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// How a map is archived where nothing is said: packed, every bit. Where it keeps CELLs compact,
/// compact within the widest of their bounds, since an archive has one form and those cannot be
/// brought into another.
ArchiveOptions default_archive_options(const MapInfo& map);

/// Writes a map of a store into an empty file, as it is at one revision: CELLs under their ids,
/// poses, constraints, sessions, scans, georeference. One CELL in memory at a time. Throws what the
/// store and `ArchiveWriter` throw, Error{kCancelled} when stopped.
void archive_map(const Store& store, const std::string& map, ByteFile& file,
                 const ArchiveOptions& options, const std::stop_token& stop = {},
                 const ProgressCallback& progress = {});

/// Makes the map `map` of what an archive holds; CELLs keep their ids, constraints are numbered
/// anew. Every hash is verified. CELLs of a compact archive are kept in its bytes and the map
/// in its form: what they decode to are CELLs of their own, with hashes of their own. Other CELLs
/// are kept raw. The map appears when it is whole, in one transaction: where it fails, is stopped
/// or killed, there is none. Throws Error{kAlreadyExists} where the name is taken. One CELL in
/// memory at a time.
MapInfo restore_map(ArchiveReader& archive, Store& store, const std::string& map,
                    const std::stop_token& stop = {}, const ProgressCallback& progress = {});

/// What an archive says of its map, as a store would. `stored_bytes` are those of the records.
MapInfo map_info(ArchiveReader& archive);
/// By id; `added` and `moved` are the archive's revision.
std::vector<CellRecord> cell_records(ArchiveReader& archive);

}  // namespace cellmap
