#include "cellmap/client/upload.hpp"

#include <optional>
#include <thread>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/pipeline/front_end.hpp"

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

/// Keeps the scans that are on their way few enough for the server's queue, because a queue that is
/// full costs a whole Retry-After. Looks at the job only when the window is used up.
class Window {
 public:
  Window(Client& client, const Job& job, const std::function<void(const Job&)>& on_progress)
      : client_(client), id_(job.id), done_(job.scans_done), on_progress_(on_progress) {}

  /// Returns when scan `next` has room, or after a second: then the server's answer decides.
  void wait_for_room(std::uint64_t next, const std::stop_token& stop) {
    constexpr std::uint64_t kScans = 8;
    constexpr std::chrono::milliseconds kLook{20}, kLongest{1'000};
    const auto begun = Clock::now();
    while (next >= done_ + kScans && !stop.stop_requested()) {
      const Job job = client_.job(id_);
      done_ = job.scans_done;
      if (on_progress_) on_progress_(job);
      if (next < done_ + kScans || is_final(job.state) || Clock::now() - begun > kLongest) return;
      std::this_thread::sleep_for(kLook);
    }
  }

 private:
  Client& client_;
  JobId id_;
  std::uint64_t done_;
  const std::function<void(const Job&)>& on_progress_;
};

}  // namespace

Job upload_drive(Client& client, const std::string& map, IngestRequest request, ScanSource& source,
                 const UploadOptions& options, const std::function<void(const Job&)>& on_progress,
                 std::stop_token stop) {
  request.path.clear();
  request.scans_total = source.size();
  Job job = wait_until_it_runs(client, start_or_join(client, map, request), options, stop);
  throw_if_failed(job);
  if (is_final(job.state) || stop.stop_requested()) return job;

  std::size_t next = job.next_scan.value();
  if (next < source.size()) source.seek(next);
  Window window(client, job, on_progress);
  while (next < source.size()) {
    window.wait_for_room(next, stop);
    const std::optional<PosedScan> scan = source.next();
    if (!scan) break;
    const auto wanted = send(client, job.id, *scan, options, stop);
    if (!wanted) return client.job(job.id);
    next = *wanted;
    if (next != scan->index + 1 && next < source.size()) source.seek(next);
  }
  return client.complete_upload(job.id);
}

SentCells upload_cells(Client& client, const std::string& map, const std::string& session,
                       ScanSource& source, const MapperOptions& options,
                       const ProgressCallback& progress, std::stop_token stop) {
  SentCells sent;
  const auto lattice = std::make_shared<const Lattice>(client.map(map).lattice);
  FrontEnd front_end(options, session, lattice);
  Progress state{0, source.size(), 0};
  for (const Session& there : client.sessions(map)) {
    if (there.name != session || !there.last_cell) continue;
    const Cell last = decode_cell(client.cell(map, *there.last_cell).encoded.bytes);
    front_end.resume_after(last);
    state.scans_done = last.first_scan + std::size_t{last.scan_count};
    state.cells_done = last.sequence + std::size_t{1};
    sent.aligned = there.aligned;
    if (state.scans_done >= source.size()) return sent;
    source.seek(state.scans_done);
  }
  const auto send = [&](const std::optional<FinishedCell>& finished) {
    if (!finished) return;
    const SessionCell answer = client.put_session_cell(map, encode_cell(finished->cell()));
    sent.cells += answer.created ? 1 : 0;
    sent.aligned = answer.aligned;
    sent.raw_points += finished->raw_points;
    ++state.cells_done;
  };
  std::optional<Pose> T_odom_last;
  while (const auto scan = source.next()) {
    if (stop.stop_requested()) return sent;
    if (T_odom_last) {
      sent.length_m += (scan->T_odom_sensor.translation() - T_odom_last->translation()).norm();
    }
    T_odom_last = scan->T_odom_sensor;
    send(front_end.add(*scan));
    ++sent.scans;
    ++state.scans_done;
    if (progress) progress(state);
  }
  send(front_end.finish());
  return sent;
}

}  // namespace cellmap
