#pragma once

#include <chrono>
#include <functional>
#include <stop_token>
#include <string>

#include "cellmap/client/client.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/pipeline/mapper_options.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

struct UploadOptions {
  /// How long a full queue, or a job that does not begin, is waited for while nothing moves.
  std::chrono::milliseconds patience{600'000};
  /// How long a server that was reached and is lost is tried again beyond the client's retries.
  std::chrono::milliseconds lost_patience{30'000};
  std::chrono::milliseconds poll{200};  ///< between looks at a job that has not begun
  /// 1 to `kMaxBatchScans`. More cost memory, and are taken in part where the server's queue is
  /// shorter; fewer cost a round trip each.
  std::size_t scans_per_request = 8;

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// What `upload_cells` did.
struct SentCells {
  std::uint64_t scans = 0, raw_points = 0;  ///< of the CELLs that were built here
  std::uint64_t cells = 0;                  ///< new to the server
  double length_m = 0;                      ///< driven
  bool aligned = false;                     ///< the session is in the map frame
};

/// Builds a drive's CELLs on this machine and sends each as soon as it is finished
/// (`Client::put_session_cell`): the scans never leave the robot. A session that is there in part
/// is continued after its last CELL. The CELLs are those that the server would have built; their
/// ties are weaker, since the server registers them by their own points. Returns early where a
/// stop is requested; the same call goes on from there. Throws what `ScanSource::next` and `Client`
/// throw.
SentCells upload_cells(Client& client, const std::string& map, const std::string& session,
                       ScanSource& source, const MapperOptions& options,
                       const ProgressCallback& progress = {}, std::stop_token stop = {});

/// Streams a drive from this machine into the session's ingest job, a few scans in memory at a
/// time, from the scan that the job expects next: it begins a session, continues one that was
/// broken off (by the client, the network or a restart of the server), and does nothing for one
/// that is whole. `request` names the session. Returns the job after its last scan was handed over;
/// it may still run: `Client::follow_job`.
///
/// `source` may be a recorded drive or a robot that drives: `next` may block until there is a scan,
/// and `size` may be 0, not known. `seek` goes forward, or back, but not before
/// `SessionScans::keep_from`.
///
/// Back-pressure: it sends as many scans a request as the job has room for; a full queue (503) is
/// waited out as Retry-After says. Where a stop is requested it returns the job as it is; the same
/// call later goes on from there. Throws the job's own error where it fails meanwhile,
/// Error{kUnavailable} where nothing moves within the patience, and what `ScanSource::next` and
/// `Client` throw.
Job upload_drive(Client& client, const std::string& map, IngestRequest request, ScanSource& source,
                 const UploadOptions& options = {},
                 const std::function<void(const Job&)>& on_progress = {},
                 std::stop_token stop = {});

/// The same, and waits until the drive is in the map: returns the job when it has ended, or as it
/// is where a stop is requested. A server that is killed before that has kept whole CELLs only; it
/// is sent the other scans once more, so the map is the same as without that.
Job deliver_drive(Client& client, const std::string& map, IngestRequest request, ScanSource& source,
                  const UploadOptions& options = {},
                  const std::function<void(const Job&)>& on_progress = {},
                  std::stop_token stop = {});

}  // namespace cellmap
