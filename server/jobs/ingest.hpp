#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "cellmap/core/progress.hpp"
#include "cellmap/pipeline/back_end.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "server/api/map_state.hpp"
#include "server/jobs/ingest_request.hpp"
#include "server/jobs/shared_drive.hpp"

namespace cellmap::server {

/// Where a session that is stored in part goes on.
struct ResumePoint {
  CellRecord record;
  std::shared_ptr<const Cell> cell;  ///< its last

  std::uint64_t next_scan() const { return cell->first_scan + std::uint64_t{cell->scan_count}; }
};
std::optional<ResumePoint> find_resume_point(const Store& store, const std::string& map,
                                             const std::string& session);

/// Ties a finished CELL to the map as it stands and commits it in its kept bytes. `cell` is of
/// `kept.cell`. The caller holds `state.writer()`. Error{kPreconditionFailed} where another server
/// changed the map meanwhile: the back end is as it was, do it again (jobs/redo.hpp).
CommitResult extend(Store& store, const MapState& state, BackEnd& back_end,
                    const FinishedCell& cell, const KeptCell& kept);

struct IngestHooks {
  /// After every scan, or every CELL of a shared drive, by the thread that reads.
  ProgressCallback progress;
  ProgressCallback committed;  ///< after every CELL, which is then durable
};

/// Reads a drive into a map, to which other sessions may be written at the same time, by other
/// servers too. `store` takes what is written: that of `maps`, or the same, fenced. Every CELL is
/// committed with its constraints and the poses it moved as one transaction, so that stopping
/// anywhere leaves whole CELLs, and running again goes on after the last of them (its base scan is
/// read again): the map is the same as that of an undisturbed run. A session that is stored whole
/// changes nothing. With `shared`, other workers help (jobs/shared_drive.hpp) where the source
/// tells its odometry before it is read; the map is the same. Throws Error{kCancelled} when
/// stopped, and whatever the source, the store and the mapper throw.
void run_ingest(Maps& maps, Store& store, const std::string& map, const IngestRequest& request,
                ScanSource& source, const std::stop_token& stop, const IngestHooks& hooks,
                const std::optional<SharedJob>& shared = {});

}  // namespace cellmap::server
