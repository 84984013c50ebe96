#pragma once

#include <functional>
#include <stop_token>

#include "cellmap/pipeline/cut_drive.hpp"
#include "cellmap/pipeline/front_end.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// Who is told what while a drive becomes CELLs.
struct CellSink {
  /// Every finished CELL, in order, on the calling thread.
  std::function<void(FinishedCell&&)> on_cell;
  /// After every scan, by the thread that reads; may be empty.
  std::function<void(const PosedScan&)> on_scan = {};
};

/// Feeds the scans that are left in `source` to `front_end`. The CELL of the last scans stays there
/// (`FrontEnd::finish`), so that a drive may come in parts. With `ahead`, source and front end work
/// on a thread of their own, at most two CELLs ahead, while `on_cell` ties the one before to the
/// map; both take about as long. The CELLs are the same. Throws what source, front end and
/// callbacks throw, and Error{kCancelled} once a stop was requested.
void make_cells(ScanSource& source, FrontEnd& front_end, bool ahead, const CellSink& sink,
                const std::stop_token& stop = {});

/// Takes the next CELL; false where nobody wants any more.
using HandOn = std::function<bool(FinishedCell&&)>;

/// Makes CELLs in order and hands them on, until there are none left or nobody wants them.
using CellFeed = std::function<void(const HandOn&)>;

/// What `make_cells` does with a feed of any kind: with `ahead` it works on a thread of its own,
/// which `interrupt` is to wake where it waits.
void feed_cells(const CellFeed& feed, bool ahead,
                const std::function<void(FinishedCell&&)>& on_cell,
                const std::function<void()>& interrupt);

/// Makes the CELLs of a stretch of a drive that begins and ends where CELLs do (`cut_drive`).
/// `front_end` is new. False where nobody wanted them all. Throws as `make_cells`.
bool make_part(ScanSource& source, FrontEnd front_end, const DriveStretch& part,
               const HandOn& hand_on, const std::stop_token& stop);

}  // namespace cellmap
