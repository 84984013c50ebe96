#pragma once

#include <functional>
#include <stop_token>

#include "cellmap/core/progress.hpp"
#include "cellmap/pipeline/mapper.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// Feeds the scans that are left in `source` to the mapper; `sink` gets every CELL as it is
/// finished (and stores it), the one of the last scans included, on the calling thread. Memory does
/// not grow with the drive except by the pose graph. Unless the mapper's options ask for one
/// thread, scans are read ahead (`make_cells`). Throws Error{kCancelled} once a stop was requested:
/// what `sink` has got stays valid, and `Mapper::resume_after` goes on from it. `progress` is
/// called after every scan, by the thread that reads.
void build_map(ScanSource& source, Mapper& mapper, const std::function<void(CellUpdate&&)>& sink,
               const std::stop_token& stop = {}, const ProgressCallback& progress = {});

}  // namespace cellmap
