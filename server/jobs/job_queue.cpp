#include "server/jobs/job_queue.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <random>

#include "cellmap/core/error.hpp"
#include "cellmap/store/convert_cells.hpp"
#include "server/jobs/convert.hpp"
#include "server/jobs/ingest.hpp"
#include "server/jobs/live_job.hpp"

// What a JobQueue takes and tells.

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

/// How soon a follower learns what another server's job has done.
constexpr std::chrono::milliseconds kLookAgain(250);

/// Machine, process and a number by chance, since numbers of processes come again.
std::string name_of_this_process() {
  std::array<char, 65> host{};
  gethostname(host.data(), host.size() - 1);
  std::random_device random;
  char number[9];
  std::snprintf(number, sizeof(number), "%08x", random());
  return std::string(host.data()) + ":" + std::to_string(getpid()) + ":" + number;
}

bool is_upload(const JobRecord& record) {
  if (record.kind != kIngestKind) return false;
  try {
    return !parse_json(record.request_json).contains("path");
  } catch (const Error&) {
    return false;  // written by another version
  }
}

/// The session that a job reads, where it reads one.
std::string session_of(const JobRecord& record) {
  if (record.kind != kIngestKind) return "";
  try {
    return parse_json(record.request_json).value("session", "");
  } catch (const Error&) {
    return "";
  }
}

/// Another server may be asked for the same at the same time.
void make_map(Store& store, const std::string& map, const IngestRequest& request) {
  try {
    store.create_map(map, request.lattice, request.form.value_or(CellForm{}));
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kAlreadyExists) throw;
  }
}

std::optional<std::string> path_of(const JobRecord& record) {
  const Json request = parse_json(record.request_json);
  if (!request.contains("path")) return std::nullopt;
  return request["path"].get<std::string>();
}

}  // namespace

JobQueue::JobQueue(Maps& maps, Metrics& metrics, std::shared_ptr<spdlog::logger> log,
                   JobQueueOptions options)
    : maps_(maps),
      store_(maps.store()),
      claims_(claims_of(store_)),
      metrics_(metrics),
      log_(std::move(log)),
      options_(std::move(options)),
      worker_(name_of_this_process()) {
  if (!options_.carries_out) return;
  claim_what_may_run();
  claimer_ = std::thread([this] { keep_claiming(); });
  for (int i = 0; i < options_.workers; ++i) workers_.emplace_back([this] { work(); });
  if (!options_.shares_drives) return;
  const auto is_idle = [this] {
    const std::lock_guard lock(mutex_);
    return live_.empty();
  };
  helper_ = std::make_unique<PartHelper>(
      maps_, metrics_, log_,
      PartHelperOptions{worker_, options_.data_roots, options_.threads, is_idle});
}

JobQueue::~JobQueue() { stop(); }

void JobQueue::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (auto& [id, job] : live_) job->stop.request_stop();
    changed_.notify_all();
    news_.notify_all();
  }
  helper_.reset();
  if (claimer_.joinable()) claimer_.join();
  for (auto& worker : workers_) {
    if (worker.joinable()) worker.join();
  }
  std::vector<Job> waiting;  // those that ran have been handed back
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, job] : live_) waiting.push_back(job);
  }
  for (const Job& job : waiting) leave(*job, "is handed back");
}

bool JobQueue::is_stopping() const {
  const std::lock_guard lock(mutex_);
  return stopping_;
}

void JobQueue::require_open() const {
  if (is_stopping()) throw Error(ErrorCode::kUnavailable, "The server is stopping.");
}

JobView JobQueue::submit(const std::string& map, const Json& json) {
  require_open();
  const IngestRequest request = parse_ingest_request(json);
  // A server that only takes jobs may not see the drives at all; who reads them looks again.
  if (request.path && (options_.carries_out || !options_.data_roots.empty())) {
    resolve_below(options_.data_roots, *request.path);
  }
  if (!request.path && !(options_.carries_out && options_.takes_scans)) {
    throw Error(ErrorCode::kUnavailable,
                "This server takes no scans (--role api); send them to one with --role all.");
  }
  const auto find_same = [&](const std::vector<HeldJob>& unfinished) -> std::optional<JobId> {
    for (const auto& [record, holder] : unfinished) {
      if (record.map != map || session_of(record) != request.session) continue;
      if (path_of(record) == request.path && !holder.cancel_asked) return record.id;
      throw Error(ErrorCode::kConflict,
                  "The session '" + request.session + "' is being read by job " +
                      std::to_string(record.id.value) + "; wait for it or cancel it.");
    }
    return no_other(unfinished);
  };
  find_same(claims_.unfinished_jobs());  // before a map is made
  try {
    store_.map(map);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kNotFound || !request.create_map) throw;
    make_map(store_, map, request);
  }
  Json kept = json;
  kept["session"] = request.session;
  JobRecord record;
  record.map = map;
  record.kind = kIngestKind;
  record.request_json = dump(kept);
  record.scans_total = request.scans_total;
  return enqueue(std::move(record), request.path.has_value(), find_same);
}

JobView JobQueue::submit_merge(const std::string& map, const Json& json) {
  require_open();
  const MergeRequest request = parse_merge_request(json);
  if (request.from == map) {
    throw Error(ErrorCode::kInvalidArgument, "A map cannot be merged with itself.");
  }
  store_.map(map);
  store_.map(request.from);
  JobRecord record;
  record.map = map;
  record.kind = kMergeKind;
  record.request_json = dump(json);
  return enqueue(std::move(record), true,
                 [this](const auto& unfinished) { return no_other(unfinished); });
}

JobView JobQueue::submit_convert(const std::string& map, const Json& json) {
  require_open();
  require_convertible(store_.map(map), parse_convert_request(json));
  JobRecord record;
  record.map = map;
  record.kind = kConvertKind;
  record.request_json = dump(json);
  return enqueue(std::move(record), true,
                 [this](const auto& unfinished) { return no_other(unfinished); });
}

/// That no job is the same; throws where there are too many of any kind.
std::optional<JobId> JobQueue::no_other(const std::vector<HeldJob>& unfinished) const {
  if (unfinished.size() < options_.max_unfinished) return std::nullopt;
  throw Error(ErrorCode::kUnavailable, "Too many unfinished jobs; try again later.");
}

JobView JobQueue::enqueue(JobRecord record, bool alone, const Claims::FindSame& find_same) {
  record = claims_.queue_job(std::move(record), alone, find_same);
  if (!alone) {
    claim_one(record.id);  // scans come here
  } else {
    const std::lock_guard lock(mutex_);
    has_news_ = true;
    news_.notify_all();
  }
  return job(record.id);
}

JobQueue::Job JobQueue::live(JobId id) const {
  const std::lock_guard lock(mutex_);
  const auto found = live_.find(id);
  return found == live_.end() ? nullptr : found->second;
}

JobView JobQueue::view(const LiveJob& job) {
  JobView result{.record = job.record,
                 .session = job.request.session,
                 .eta_s = {},
                 .next_scan = {},
                 .holder = job.holder};
  result.version = job.version;
  if (job.upload) {
    result.next_scan = job.upload->next_scan();
    result.room = job.upload->room();
    result.completed = job.upload->is_complete();
  }
  if (job.record.state != JobState::kRunning) return result;
  const double seconds = std::chrono::duration<double>(Clock::now() - job.started).count();
  const std::uint64_t done = job.record.scans_done - job.scans_at_start;
  if (done > 0 && seconds > 0) result.scans_per_second = static_cast<double>(done) / seconds;
  if (result.scans_per_second > 0 && job.record.scans_total >= job.record.scans_done) {
    result.eta_s = static_cast<double>(job.record.scans_total - job.record.scans_done) /
                   result.scans_per_second;
  }
  return result;
}

JobView JobQueue::view(const JobRecord& record) {
  JobView result{
      .record = record, .session = session_of(record), .eta_s = {}, .next_scan = {}, .holder = {}};
  if (is_upload(record)) result.next_scan = record.scans_done;
  result.version = static_cast<std::uint64_t>(record.updated);
  return result;
}

/// As another server's job, or nobody's, unless it is this one's.
JobView JobQueue::view_of(const HeldJob& held) const {
  if (auto view = view_of_live(held.record.id)) return *std::move(view);
  JobView result = view(held.record);
  result.holder = held.holder;
  if (result.next_scan) {
    // Scans that are in no CELL yet are lost with the server that has them: whoever takes the job
    // over asks for them again.
    const auto resume = find_resume_point(store_, held.record.map, result.session);
    result.next_scan = resume ? resume->cell->first_scan : 0;
  }
  return result;
}

std::optional<JobView> JobQueue::view_of_live(JobId id) const {
  const std::lock_guard lock(mutex_);
  const auto found = live_.find(id);
  return found == live_.end() ? std::nullopt : std::optional(view(*found->second));
}

JobView JobQueue::job(JobId id) const {
  if (auto view = view_of_live(id)) return *std::move(view);
  const JobRecord record = store_.job(id);
  if (is_final(record.state)) return view(record);
  for (const HeldJob& held : claims_.unfinished_jobs(record.map)) {
    if (held.record.id == id) return view_of(held);
  }
  return view(store_.job(id));  // it ended meanwhile
}

std::vector<JobView> JobQueue::jobs(const std::string& map) const {
  store_.map(map);
  std::map<JobId, JobView> views;
  for (const auto& record : store_.jobs(map)) views.insert_or_assign(record.id, view(record));
  for (const auto& held : claims_.unfinished_jobs(map)) {
    views.insert_or_assign(held.record.id, view_of(held));
  }
  std::vector<JobView> result;
  for (auto& [id, view] : views) result.push_back(std::move(view));
  return result;
}

std::optional<JobView> JobQueue::latest_job(const std::string& map,
                                            const std::string& session) const {
  for (const auto& held : claims_.unfinished_jobs(map)) {
    if (session_of(held.record) == session) return view_of(held);
  }
  const Stamp made = store_.version(map).created;
  std::optional<JobView> latest;
  for (const auto& record : store_.jobs(map)) {
    if (session_of(record) == session && record.created >= made) latest = view(record);
  }
  return latest;
}

JobView JobQueue::cancel(JobId id) {
  claims_.ask_to_cancel(id);
  const auto job = live(id);
  if (!job) return this->job(id);
  const std::lock_guard lock(mutex_);
  job->cancel_asked = true;
  job->stop.request_stop();
  touch(*job);
  return view(*job);
}

/// Scans come to this server, so a job that nobody works at becomes its own.
JobQueue::Job JobQueue::upload_of(JobId id) {
  auto job = live(id);
  if (!job) {
    const JobRecord record = store_.job(id);
    if (is_final(record.state)) {
      throw Error(ErrorCode::kConflict, "The job has ended and takes no more scans.");
    }
    require_open();
    if (is_upload(record) && options_.carries_out && options_.takes_scans) job = claim_one(id);
    if (!job && is_upload(record)) {
      const auto holder = this->job(id).holder;
      throw Error(ErrorCode::kUnavailable,
                  holder && !holder->worker.empty()
                      ? "The job is carried out by " + holder->worker + "; send its scans there."
                      : "This server takes no scans (--role api); send them to one with --role "
                        "all.");
    }
  }
  if (!job || !job->upload) {
    throw Error(ErrorCode::kConflict, "This job reads a path and takes no scans.");
  }
  return job;
}

UploadSource::Put JobQueue::put_scan(JobId id, PosedScan scan) {
  const auto job = upload_of(id);
  require_open();
  if (job->stop.stop_requested()) {
    throw Error(ErrorCode::kConflict, "The job is stopping and takes no more scans.");
  }
  return job->upload->put(std::move(scan));
}

JobView JobQueue::complete(JobId id) {
  if (!live(id)) {
    const auto ended = store_.job(id);
    if (ended.state == JobState::kSucceeded) return view(ended);
  }
  const auto job = upload_of(id);
  job->upload->complete();
  const std::lock_guard lock(mutex_);
  return view(*job);
}

JobView JobQueue::wait(JobId id, std::uint64_t seen, std::chrono::milliseconds timeout) const {
  const auto deadline = Clock::now() + timeout;
  for (;;) {
    const auto is_over = [&](const JobView& job) {
      return stopping_ || job.version != seen || is_final(job.record.state);
    };
    if (const auto own = live(id)) {
      std::unique_lock lock(mutex_);
      changed_.wait_until(lock, deadline, [&] { return own->is_lost || is_over(view(*own)); });
      if (!own->is_lost) return view(*own);
    }
    JobView other = job(id);
    std::unique_lock lock(mutex_);
    if (is_over(other) || Clock::now() >= deadline) return other;
    changed_.wait_until(lock, std::min(deadline, Clock::now() + kLookAgain));
  }
}

JobQueue::Counts JobQueue::unfinished() const {
  Counts counts;
  for (const HeldJob& held : claims_.unfinished_jobs()) {
    if (held.holder.worker.empty()) ++counts.queued;
  }
  const std::lock_guard lock(mutex_);
  for (const auto& [id, job] : live_) {
    ++(job->record.state == JobState::kRunning ? counts.running : counts.queued);
  }
  return counts;
}

bool JobQueue::has_unfinished(const std::string& map) const {
  return !claims_.unfinished_jobs(map).empty();
}

}  // namespace cellmap::server
