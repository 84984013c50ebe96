#pragma once

#include <chrono>
#include <functional>
#include <stop_token>
#include <string>

#include "cellmap/client/client.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

struct UploadOptions {
  /// How long a full queue, or a job that does not begin, is waited for while nothing moves.
  std::chrono::milliseconds patience{600'000};
  std::chrono::milliseconds poll{200};  ///< between looks at a job that has not begun
};

/// Streams a drive from this machine into an ingest job, one scan in memory at a time, from the
/// scan that the job expects next: it begins a session, continues one that was broken off (by
/// the client, the network or a restart of the server), and does nothing for one that is whole.
/// Returns the job after its last scan was handed over; it may still run: `Client::follow_job`.
///
/// Back-pressure: a full queue (503) is waited out as Retry-After says. Where a stop is
/// requested it returns the job as it is; the same call later goes on from there.
/// Throws the job's own error where it fails meanwhile, Error{kUnavailable} where nothing moves
/// within the patience, and what `ScanSource::next` and `Client` throw.
Job upload_drive(Client& client, const std::string& map, IngestRequest request, ScanSource& source,
                 const UploadOptions& options = {},
                 const std::function<void(const Job&)>& on_progress = {},
                 std::stop_token stop = {});

}  // namespace cellmap
