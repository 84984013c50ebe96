#include "cellmap/client/upload.hpp"

#include <optional>
#include <thread>

namespace cellmap {
namespace {

using Clock = std::chrono::steady_clock;

/// The session's unfinished job where there is one, else a new one.
Job start_or_join(Client& client, const std::string& map, const IngestRequest& request) {
  try {
    return client.start_ingest(map, request);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kConflict) throw;
    for (const Job& job : client.jobs(map)) {
      if (job.session == request.session && !is_final(job.state)) return job;
    }
    throw;
  }
}

void throw_if_failed(const Job& job) {
  if (job.state == JobState::kCancelled) {
    throw Error(ErrorCode::kCancelled, "job " + std::to_string(job.id.value) +
                                           " was cancelled; whole CELLs stay in map '" + job.map +
                                           "'");
  }
  if (job.state == JobState::kFailed) {
    throw Error(job.error_code.value_or(ErrorCode::kInternal),
                "job " + std::to_string(job.id.value) + " failed: " + job.error_message);
  }
}

/// Gives up where nothing has moved for too long.
class Patience {
 public:
  explicit Patience(std::chrono::milliseconds limit) : limit_(limit), since_(Clock::now()) {}
  void moved() { since_ = Clock::now(); }
  bool over() const { return Clock::now() - since_ > limit_; }

 private:
  std::chrono::milliseconds limit_;
  Clock::time_point since_;
};

/// Waits until the job says which scan it wants (it may be queued behind another).
Job wait_until_it_runs(Client& client, Job job, const UploadOptions& options,
                       const std::stop_token& stop) {
  Patience patience(options.patience);
  while (!job.next_scan && !is_final(job.state) && !stop.stop_requested()) {
    if (patience.over()) {
      throw Error(ErrorCode::kUnavailable,
                  "job " + std::to_string(job.id.value) + " is still " +
                      std::string(to_string(job.state)) +
                      " and expects no scans; see 'cellmap jobs list' for what it waits for");
    }
    std::this_thread::sleep_for(options.poll);
    job = client.job(job.id);
  }
  return job;
}

/// Sends one scan, waiting out a full queue. Returns the index that is wanted next, or nullopt
/// where the job has ended or a stop was requested.
std::optional<std::uint64_t> send(Client& client, JobId id, const PosedScan& scan,
                                  const UploadOptions& options, const std::stop_token& stop) {
  Patience patience(options.patience);
  while (!stop.stop_requested()) {
    try {
      const PutScanResult result = client.put_scan(id, scan);
      return result.accepted ? scan.index + 1 : result.next_scan;
    } catch (const Error& error) {
      const bool busy = error.code() == ErrorCode::kUnavailable;
      if (!busy && error.code() != ErrorCode::kConflict) throw;
      const Job job = client.job(id);
      throw_if_failed(job);
      if (is_final(job.state)) return std::nullopt;
      if (!busy || patience.over()) throw;
    }
  }
  return std::nullopt;
}

}  // namespace

Job upload_drive(Client& client, const std::string& map, IngestRequest request, ScanSource& source,
                 const UploadOptions& options, const std::function<void(const Job&)>& on_progress,
                 std::stop_token stop) {
  constexpr std::size_t kScansBetweenLooks = 10;
  request.path.clear();
  request.scans_total = source.size();
  Job job = wait_until_it_runs(client, start_or_join(client, map, request), options, stop);
  throw_if_failed(job);
  if (is_final(job.state) || stop.stop_requested()) return job;

  std::size_t next = job.next_scan.value();
  if (next < source.size()) source.seek(next);
  while (next < source.size()) {
    const std::optional<PosedScan> scan = source.next();
    if (!scan) break;
    const auto wanted = send(client, job.id, *scan, options, stop);
    if (!wanted) return client.job(job.id);
    next = *wanted;
    if (next != scan->index + 1 && next < source.size()) source.seek(next);
    if (on_progress && next % kScansBetweenLooks == 0) on_progress(client.job(job.id));
  }
  return client.complete_upload(job.id);
}

}  // namespace cellmap
