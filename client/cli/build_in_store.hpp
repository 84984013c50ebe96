#pragma once

#include <stop_token>
#include <string>

#include "cellmap/core/progress.hpp"
#include "cellmap/pipeline/mapper.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap::cli {

/// Maps a drive into a map of a store, CELL by CELL: each is committed before the next begins, so a
/// build that is broken off (Error{kCancelled} on request, or a crash) goes on after the last
/// stored CELL when it is called again, and one that is whole does nothing. Makes the map where it
/// is missing. The bytes are those that the server's job would store. Throws Error{kConflict} where
/// the map has another lattice than the one asked for. `form`: in which the CELLs of this drive are
/// kept, and those to come where the map is made; unset: the map's.
MapInfo build_in_store(Store& store, const std::string& map,
                       const std::optional<LatticeSpec>& lattice,
                       const std::optional<CellForm>& form, const std::string& session,
                       ScanSource& source, const MapperOptions& options,
                       const std::stop_token& stop, const ProgressCallback& progress);

}  // namespace cellmap::cli
