#include "cellmap/client/upload.hpp"

#include <optional>
#include <span>
#include <thread>
#include <type_traits>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/scan_batch.hpp"
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

/// Asks again while the server cannot be reached.
template <typename Call>
std::invoke_result_t<Call> while_lost(const UploadOptions& options, const std::stop_token& stop,
                                      const Call& call) {
  const Patience patience(options.lost_patience);
  for (;;) {
    try {
      return call();
    } catch (const Error& error) {
      if (!may_pass(error.code()) || patience.over() || stop.stop_requested()) throw;
    }
    std::this_thread::sleep_for(options.poll);
  }
}

/// Where nobody is reached at first, that is told at once: the address is wrong more often than the
/// server restarts. Once it was reached it is waited for.
Job start_patiently(Client& client, const std::string& map, const IngestRequest& request,
                    const UploadOptions& options, const std::stop_token& stop) {
  try {
    return start_or_join(client, map, request);
  } catch (const Error& error) {
    if (!is_io(error.code())) throw;
  }
  return while_lost(options, stop, [&] { return start_or_join(client, map, request); });
}

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
    job = while_lost(options, stop, [&] { return client.job(job.id); });
  }
  return job;
}

/// Hands a drive over, several scans a request, and goes back where the server asks for it.
class Sender {
 public:
  Sender(Client& client, std::string map, std::string session, ScanSource& source,
         const UploadOptions& options, const std::function<void(const Job&)>& on_progress,
         std::stop_token stop)
      : client_(client),
        map_(std::move(map)),
        session_(std::move(session)),
        source_(source),
        options_(options),
        on_progress_(on_progress),
        stop_(std::move(stop)) {}

  /// Sends the drive from `job.next_scan` on. Returns the job, completed where all was sent.
  Job run(Job job) {
    job_ = std::move(job);
    go_to(job_.next_scan.value());
    while (!stop_.stop_requested()) {
      wait_for_room();
      read_ahead();
      if (scans_.empty()) {
        if (const auto completed = complete()) return *completed;
        continue;
      }
      const auto standing = send();
      if (!standing) break;
      take(*standing);
      if (!standing->next_scan || standing->state == SessionScans::State::kEnded) break;
      go_on_at(*standing->next_scan);
    }
    return patiently([&] { return client_.job(job_.id); });
  }

 private:
  void go_to(std::uint64_t index) {
    scans_.clear();
    next_ = index;
    ended_ = source_.size() > 0 && index >= source_.size();
    if (!ended_) source_.seek(index);
    per_request_ = 1;  // a job that goes on reads one scan, then asks for a later one
  }

  /// After a request: what was taken is let go.
  void go_on_at(std::uint64_t next) {
    const std::uint64_t first = scans_.front().index, end = scans_.back().index + 1;
    if (next < first || next > end) return go_to(next);
    next_ = next;
    scans_.erase(scans_.begin(), scans_.begin() + static_cast<std::ptrdiff_t>(next - first));
    per_request_ = options_.scans_per_request;
  }

  void read_ahead() {
    std::size_t points = 0;
    for (const PosedScan& scan : scans_) points += scan.points.size();
    while (!ended_ && scans_.size() < per_request_ && points < kPointsARequest) {
      auto scan = source_.next();
      ended_ = !scan;
      if (ended_) return;
      points += scan->points.size();
      scans_.push_back(*std::move(scan));
    }
  }

  /// As many scans as fit a request.
  std::span<const PosedScan> next_request() const {
    std::size_t count = 0, points = 0;
    for (const PosedScan& scan : scans_) {
      points += scan.points.size();
      if (count > 0 && (points > kMaxScanPoints || count == per_request_)) break;
      ++count;
    }
    return std::span(scans_).first(count);
  }

  /// The answer to the next request; nullopt where the job has ended or a stop was requested. A
  /// full queue is waited out, and a lost connection.
  std::optional<SessionScans> send() {
    Patience patience(options_.patience);
    while (!stop_.stop_requested()) {
      try {
        return client_.post_session_scans(map_, session_, next_request());
      } catch (const Error& error) {
        const bool conflict = error.code() == ErrorCode::kConflict;
        if (!conflict && !may_pass(error.code())) throw;
        const Job job = patiently([&] { return client_.job(job_.id); });
        throw_if_failed(job);
        if (is_final(job.state)) return std::nullopt;
        if (conflict || patience.over()) throw;
      }
    }
    return std::nullopt;
  }

  template <typename Call>
  std::invoke_result_t<Call> patiently(const Call& call) {
    return while_lost(options_, stop_, call);
  }

  /// Says how many scans there were: a server that was restarted meanwhile, and lost those that
  /// were not in a CELL yet, refuses, and is sent them again (nullopt).
  std::optional<Job> complete() {
    try {
      return patiently([&] { return client_.complete_upload(job_.id, next_); });
    } catch (const Error& error) {
      if (error.code() != ErrorCode::kConflict) throw;
      job_ = patiently([&] { return client_.job(job_.id); });
      throw_if_failed(job_);
      if (is_final(job_.state) || !job_.next_scan || *job_.next_scan == next_) throw;
    }
    go_to(*job_.next_scan);
    return std::nullopt;
  }

  void take(const SessionScans& standing) {
    room_ = standing.room;
    if (!standing.job) return;
    job_ = *standing.job;
    if (on_progress_) on_progress_(job_);
  }

  /// Returns when half a request has room, or after a second: then the server's answer decides. A
  /// queue that is full costs a whole Retry-After and the scans once more.
  void wait_for_room() {
    constexpr std::chrono::milliseconds kLook{20}, kLongest{1'000};
    const auto begun = Clock::now();
    while (room_ < (per_request_ + 1) / 2 && !stop_.stop_requested()) {
      std::this_thread::sleep_for(kLook);
      take(patiently([&] { return client_.session_scans(map_, session_); }));
      if (is_final(job_.state) || Clock::now() - begun > kLongest) return;
    }
  }

  static constexpr std::size_t kPointsARequest = 1'000'000;

  Client& client_;
  std::string map_, session_;
  ScanSource& source_;
  UploadOptions options_;
  const std::function<void(const Job&)>& on_progress_;
  std::stop_token stop_;
  Job job_;
  std::vector<PosedScan> scans_;  // read and not yet taken
  std::uint64_t next_ = 0;        // the scan that the server expects
  std::size_t per_request_ = 1;
  std::uint64_t room_ = 1;
  bool ended_ = false;  // the source gave its last scan
};

}  // namespace

void UploadOptions::validate() const {
  if (scans_per_request < 1 || scans_per_request > kMaxBatchScans) {
    throw Error(ErrorCode::kInvalidArgument, "scans_per_request must be 1 to " +
                                                 std::to_string(kMaxBatchScans) + ", not " +
                                                 std::to_string(scans_per_request));
  }
}

Job upload_drive(Client& client, const std::string& map, IngestRequest request, ScanSource& source,
                 const UploadOptions& options, const std::function<void(const Job&)>& on_progress,
                 std::stop_token stop) {
  options.validate();
  request.path.clear();
  request.scans_total = source.size();
  const Job job = wait_until_it_runs(client, start_patiently(client, map, request, options, stop),
                                     options, stop);
  throw_if_failed(job);
  if (is_final(job.state) || stop.stop_requested()) return job;
  return Sender(client, map, request.session, source, options, on_progress, stop).run(job);
}

Job deliver_drive(Client& client, const std::string& map, IngestRequest request, ScanSource& source,
                  const UploadOptions& options, const std::function<void(const Job&)>& on_progress,
                  std::stop_token stop) {
  for (;;) {
    Job job = upload_drive(client, map, request, source, options, on_progress, stop);
    bool has_all = true;
    while (has_all && !is_final(job.state) && !stop.stop_requested()) {
      std::this_thread::sleep_for(options.poll);
      const SessionScans standing =
          while_lost(options, stop, [&] { return client.session_scans(map, request.session); });
      if (standing.job) job = *standing.job;
      if (on_progress) on_progress(job);
      has_all = standing.state != SessionScans::State::kMapping;
    }
    if (has_all) return job;
  }
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
