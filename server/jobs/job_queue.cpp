#include "server/jobs/job_queue.hpp"

#include <algorithm>
#include <stop_token>

#include "cellmap/core/error.hpp"
#include "cellmap/store/convert_cells.hpp"
#include "server/jobs/convert.hpp"
#include "server/jobs/ingest.hpp"

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

constexpr const char* kIngestKind = "ingest";
constexpr const char* kMergeKind = "merge";
constexpr const char* kConvertKind = "convert";

std::string name_of(JobId id) { return "job " + std::to_string(id.value); }

bool is_same_drive(const IngestRequest& a, const IngestRequest& b) {
  return a.session == b.session && a.path == b.path;
}

}  // namespace

/// An unfinished job. Everything but what was asked for and `upload` is guarded by the queue's
/// mutex.
struct JobQueue::LiveJob {
  JobRecord record;
  IngestRequest request;              ///< of an ingest
  std::optional<MergeRequest> merge;  ///< of a merge
  std::optional<CellForm> convert;    ///< of a conversion
  std::stop_source stop;
  std::unique_ptr<UploadSource> upload;  ///< of an ingest without a path
  bool is_ingest() const { return !merge && !convert; }
  bool cancel_asked = false;
  std::uint64_t version = 1;
  Clock::time_point started{};
  std::uint64_t scans_at_start = 0;
};

JobQueue::JobQueue(Maps& maps, Metrics& metrics, std::shared_ptr<spdlog::logger> log,
                   JobQueueOptions options)
    : maps_(maps),
      store_(maps.store()),
      metrics_(metrics),
      log_(std::move(log)),
      options_(std::move(options)) {
  if (!options_.carries_out) return;
  recover();
  for (int i = 0; i < options_.workers; ++i) workers_.emplace_back([this] { work(); });
}

JobQueue::~JobQueue() { stop(); }

void JobQueue::stop() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    for (auto& [id, job] : live_) job->stop.request_stop();
    changed_.notify_all();
  }
  for (auto& worker : workers_) {
    if (worker.joinable()) worker.join();
  }
}

bool JobQueue::is_stopping() const {
  const std::lock_guard lock(mutex_);
  return stopping_;
}

std::shared_ptr<JobQueue::LiveJob> JobQueue::make_live(JobRecord record,
                                                       IngestRequest request) const {
  auto job = std::make_shared<LiveJob>();
  job->record = std::move(record);
  job->request = std::move(request);
  MapperOptions& mapper = job->request.options;  // its results do not depend on threads
  mapper.build.threads = mapper.registration.threads = options_.threads;
  mapper.loops.registration.threads = mapper.pose_graph.threads = options_.threads;
  if (!job->request.path) {
    const auto resume = find_resume_point(store_, job->record.map, job->request.session);
    job->upload = std::make_unique<UploadSource>(job->request.scans_total,
                                                 resume ? resume->cell->first_scan : 0,
                                                 job->stop.get_token(), options_.upload);
  }
  return job;
}

std::shared_ptr<JobQueue::LiveJob> JobQueue::make_live(JobRecord record,
                                                       MergeRequest request) const {
  auto job = std::make_shared<LiveJob>();
  job->record = std::move(record);
  MapperOptions& mapper = request.options;
  mapper.loops.registration.threads = mapper.pose_graph.threads = options_.threads;
  mapper.junction.relocalise.threads = options_.threads;
  job->merge = std::move(request);
  return job;
}

std::shared_ptr<JobQueue::LiveJob> JobQueue::make_live(JobRecord record,
                                                       const CellForm& form) const {
  auto job = std::make_shared<LiveJob>();
  job->record = std::move(record);
  job->convert = form;
  return job;
}

std::shared_ptr<JobQueue::LiveJob> JobQueue::revive(JobRecord record) const {
  const Json request = parse_json(record.request_json);
  if (record.kind == kMergeKind) return make_live(std::move(record), parse_merge_request(request));
  if (record.kind == kConvertKind) {
    return make_live(std::move(record), parse_convert_request(request));
  }
  return make_live(std::move(record), parse_ingest_request(request));
}

void JobQueue::recover() {
  for (auto& record : store_.jobs()) {
    if (is_final(record.state)) continue;
    try {
      record.state = JobState::kQueued;
      live_.emplace(record.id, revive(record));
      log_->info("{} ({}) goes on after a restart", name_of(record.id), record.map);
    } catch (const Error& error) {
      record.state = JobState::kFailed;
      record.error_code = to_string(error.code());
      record.error_message = error.what();
      store_.update_job(record);
      log_->error("{} cannot go on: {}", name_of(record.id), error.what());
    }
  }
}

JobView JobQueue::submit(const std::string& map, const Json& json) {
  IngestRequest request = parse_ingest_request(json);
  if (request.path) resolve_below(options_.data_roots, *request.path);
  const std::lock_guard submit_lock(submit_mutex_);
  {
    const std::lock_guard lock(mutex_);
    require_room();
    for (const auto& [id, job] : live_) {
      if (!job->is_ingest() || job->record.map != map || job->request.session != request.session) {
        continue;
      }
      if (is_same_drive(job->request, request) && !job->cancel_asked) return view(*job);
      throw Error(ErrorCode::kConflict, "The session '" + request.session + "' is being read by " +
                                            name_of(id) + "; wait for it or cancel it.");
    }
  }
  try {
    store_.map(map);
  } catch (const Error& error) {
    if (error.code() != ErrorCode::kNotFound || !request.create_map) throw;
    store_.create_map(map, request.lattice, request.form.value_or(CellForm{}));
  }
  Json kept = json;
  kept["session"] = request.session;
  JobRecord record;
  record.map = map;
  record.kind = kIngestKind;
  record.request_json = dump(kept);
  record.scans_total = request.scans_total;
  record = store_.create_job(record);
  return start(make_live(record, std::move(request)));
}

JobView JobQueue::submit_merge(const std::string& map, const Json& json) {
  MergeRequest request = parse_merge_request(json);
  if (request.from == map) {
    throw Error(ErrorCode::kInvalidArgument, "A map cannot be merged with itself.");
  }
  store_.map(map);
  store_.map(request.from);
  const std::lock_guard submit_lock(submit_mutex_);
  {
    const std::lock_guard lock(mutex_);
    require_room();
  }
  JobRecord record;
  record.map = map;
  record.kind = kMergeKind;
  record.request_json = dump(json);
  record = store_.create_job(record);
  return start(make_live(record, std::move(request)));
}

JobView JobQueue::submit_convert(const std::string& map, const Json& json) {
  const CellForm form = parse_convert_request(json);
  require_convertible(store_.map(map), form);
  const std::lock_guard submit_lock(submit_mutex_);
  {
    const std::lock_guard lock(mutex_);
    require_room();
  }
  JobRecord record;
  record.map = map;
  record.kind = kConvertKind;
  record.request_json = dump(json);
  record = store_.create_job(record);
  return start(make_live(record, form));
}

/// Under the mutex.
void JobQueue::require_room() const {
  if (stopping_) throw Error(ErrorCode::kUnavailable, "The server is stopping.");
  if (!options_.carries_out) {
    throw Error(ErrorCode::kUnavailable,
                "This server carries out no jobs (--role api); send them to the one that does.");
  }
  if (live_.size() >= options_.max_unfinished) {
    throw Error(ErrorCode::kUnavailable, "Too many unfinished jobs; try again later.");
  }
}

JobView JobQueue::start(std::shared_ptr<LiveJob> job) {
  const std::lock_guard lock(mutex_);
  live_.emplace(job->record.id, job);
  changed_.notify_all();
  return view(*job);
}

std::shared_ptr<JobQueue::LiveJob> JobQueue::live(JobId id) const {
  const std::lock_guard lock(mutex_);
  const auto found = live_.find(id);
  return found == live_.end() ? nullptr : found->second;
}

JobView JobQueue::view(const LiveJob& job) {
  JobView result{
      .record = job.record, .session = job.request.session, .eta_s = {}, .next_scan = {}};
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
  JobView result{.record = record, .session = {}, .eta_s = {}, .next_scan = {}};
  try {
    const Json request = parse_json(record.request_json);
    result.session = request.value("session", "");
    if (record.kind == kIngestKind && !request.contains("path"))
      result.next_scan = record.scans_done;
  } catch (const Error&) {
    // A record written by another version: everything else still holds.
  }
  return result;
}

JobView JobQueue::job(JobId id) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = live_.find(id); found != live_.end()) return view(*found->second);
  }
  return view(store_.job(id));
}

std::vector<JobView> JobQueue::jobs(const std::string& map) const {
  store_.map(map);
  std::vector<JobView> views;
  for (const auto& record : store_.jobs(map)) {
    const std::lock_guard lock(mutex_);
    const auto found = live_.find(record.id);
    views.push_back(found == live_.end() ? view(record) : view(*found->second));
  }
  std::ranges::sort(views, {}, [](const JobView& view) { return view.record.id; });
  return views;
}

std::optional<JobView> JobQueue::latest_job(const std::string& map,
                                            const std::string& session) const {
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, job] : live_) {
      if (job->record.map == map && job->request.session == session) return view(*job);
    }
  }
  const Stamp made = store_.version(map).created;
  std::optional<JobView> latest;
  for (const auto& record : store_.jobs(map)) {
    JobView job = view(record);
    if (job.session != session || record.created < made) continue;
    if (!latest || latest->record.id < record.id) latest = std::move(job);
  }
  return latest;
}

JobView JobQueue::cancel(JobId id) {
  const auto job = live(id);
  if (!job) {
    const auto ended = store_.job(id);
    throw Error(ErrorCode::kConflict,
                "The job has ended: it is " + std::string(to_string(ended.state)) + ".");
  }
  std::unique_lock lock(mutex_);
  job->cancel_asked = true;
  job->stop.request_stop();
  touch(*job);
  return view(*job);
}

std::shared_ptr<JobQueue::LiveJob> JobQueue::upload_of(JobId id) const {
  auto job = live(id);
  if (!job) {
    store_.job(id);
    throw Error(ErrorCode::kConflict, "The job has ended and takes no more scans.");
  }
  if (!job->upload) throw Error(ErrorCode::kConflict, "This job reads a path and takes no scans.");
  return job;
}

UploadSource::Put JobQueue::put_scan(JobId id, PosedScan scan) {
  const auto job = upload_of(id);
  if (is_stopping()) throw Error(ErrorCode::kUnavailable, "The server is stopping.");
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
  if (const auto job = live(id)) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, timeout, [&] {
      return stopping_ || job->version != seen || is_final(job->record.state);
    });
    return view(*job);
  }
  return view(store_.job(id));
}

JobQueue::Counts JobQueue::unfinished() const {
  Counts counts;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, job] : live_) {
    ++(job->record.state == JobState::kRunning ? counts.running : counts.queued);
  }
  return counts;
}

bool JobQueue::has_unfinished(const std::string& map) const {
  const std::lock_guard lock(mutex_);
  return std::ranges::any_of(live_,
                             [&](const auto& entry) { return entry.second->record.map == map; });
}

void JobQueue::touch(LiveJob& job) {
  ++job.version;
  changed_.notify_all();
}

/// The oldest queued job that may run, or that only has to be ended. Recorded drives enter a map
/// one after the other, so that it does not depend on the weather; what robots send cannot wait.
/// Under the mutex.
std::shared_ptr<JobQueue::LiveJob> JobQueue::next_runnable() const {
  for (const auto& [id, job] : live_) {
    if (job->record.state != JobState::kQueued) continue;
    const bool waits = !job->upload && std::ranges::any_of(live_, [&](const auto& other) {
      return !other.second->upload && other.second->record.map == job->record.map &&
             other.second->record.state == JobState::kRunning;
    });
    if (!waits || job->cancel_asked) return job;
  }
  return nullptr;
}

void JobQueue::work() {
  for (;;) {
    std::shared_ptr<LiveJob> job;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return stopping_ || (job = next_runnable()) != nullptr; });
      if (stopping_) return;
      job->record.state = JobState::kRunning;
      job->started = Clock::now();
      touch(*job);
    }
    run(*job);
  }
}

void JobQueue::run(LiveJob& job) {
  const auto keep_progress = [&](const Progress& progress) {
    const std::lock_guard lock(mutex_);
    // What was stored before this run says nothing about its speed.
    if (job.record.scans_done == 0) job.scans_at_start = progress.scans_done;
    job.record.scans_done = progress.scans_done;
    job.record.scans_total = progress.scans_total;
    job.record.cells_done = progress.cells_done;
    touch(job);
  };
  const auto keep_cell = [&](const Progress& progress) {
    keep_progress(progress);
    metrics_.cells_committed(1);
    JobRecord record;
    {
      const std::lock_guard lock(mutex_);
      record = job.record;
    }
    store_.update_job(record);
  };
  try {
    throw_if_stopped(job.stop.get_token());
    carry_out(job, {keep_progress, keep_cell});
    finish(job, JobState::kSucceeded, "", "");
  } catch (const Error& error) {
    const bool stopped = error.code() == ErrorCode::kCancelled;
    if (stopped && !job.cancel_asked && is_stopping()) {
      return finish(job, JobState::kQueued, "", "");
    }
    finish(job, stopped ? JobState::kCancelled : JobState::kFailed,
           std::string(to_string(error.code())), error.what());
  } catch (const std::exception& error) {
    log_->error("{}: {}", name_of(job.record.id), error.what());
    finish(job, JobState::kFailed, "internal", "A fault of the server; its log says more.");
  }
}

void JobQueue::carry_out(LiveJob& job, const IngestHooks& hooks) {
  const std::string name = name_of(job.record.id);
  if (job.merge) {
    log_->info("{} merges map '{}' into map '{}'", name, job.merge->from, job.record.map);
    return run_merge(maps_, job.record.map, *job.merge, job.stop.get_token(), hooks);
  }
  if (job.convert) {
    log_->info("{} converts map '{}' to {}", name, job.record.map, to_string(*job.convert));
    return run_convert(maps_, job.record.map, *job.convert, job.stop.get_token(), hooks);
  }
  std::unique_ptr<ScanSource> opened;
  if (job.request.path) opened = open_request(job.request, options_.data_roots);
  ScanSource& source = opened ? *opened : *job.upload;
  log_->info("{} reads session '{}' into map '{}'", name, job.request.session, job.record.map);
  {
    const std::lock_guard lock(mutex_);
    job.record.scans_done = 0;
  }
  run_ingest(maps_, job.record.map, job.request, source, job.stop.get_token(), hooks);
}

/// `kQueued`: the server stops and the job goes on at the next start.
void JobQueue::finish(LiveJob& job, JobState state, const std::string& code,
                      const std::string& message) {
  JobRecord record;
  {
    const std::lock_guard lock(mutex_);
    record = job.record;
  }
  record.state = state;
  if (state == JobState::kFailed || state == JobState::kCancelled) {
    record.error_code = code;
    record.error_message = message;
  }
  try {
    store_.update_job(record);
    if (is_final(state)) record = store_.job(record.id);
  } catch (const Error& error) {
    log_->error("{} could not be recorded: {}", name_of(record.id), error.what());
  }
  log_->info("{} is {}{}{}", name_of(record.id), to_string(state), message.empty() ? "" : ": ",
             message);
  if (is_final(state)) metrics_.job_ended(std::string(to_string(state)));
  const std::lock_guard lock(mutex_);
  job.record = record;
  if (is_final(state)) live_.erase(record.id);
  touch(job);
}

}  // namespace cellmap::server
