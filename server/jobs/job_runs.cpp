#include "cellmap/core/error.hpp"
#include "server/jobs/convert.hpp"
#include "server/jobs/ingest.hpp"
#include "server/jobs/job_queue.hpp"
#include "server/jobs/live_job.hpp"

// How a JobQueue carries out the jobs that it has claimed.

namespace cellmap::server {
namespace {

std::string name_of(JobId id) { return "job " + std::to_string(id.value); }

}  // namespace

void JobQueue::touch(LiveJob& job) {
  ++job.version;
  changed_.notify_all();
}

void JobQueue::work() {
  for (;;) {
    Job job;
    {
      std::unique_lock lock(mutex_);
      const auto find = [&] {
        for (const auto& [id, claimed] : live_) {
          if (claimed->record.state == JobState::kQueued) return (job = claimed) != nullptr;
        }
        return false;
      };
      changed_.wait(lock, [&] { return stopping_ || find(); });
      if (stopping_) return;
      job->record.state = JobState::kRunning;
      job->started = std::chrono::steady_clock::now();
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
  const auto store_record = [&] {
    JobRecord record;
    {
      const std::lock_guard lock(mutex_);
      record = job.record;
    }
    job.store->update_job(record);
  };
  const auto keep_cell = [&](const Progress& progress) {
    keep_progress(progress);
    metrics_.cells_committed(1);
    store_record();
    heed(claims_.unfinished_jobs(job.record.map));  // somebody may have cancelled it
  };
  try {
    throw_if_stopped(job.stop.get_token());
    store_record();  // that it runs
    carry_out(job, {keep_progress, keep_cell});
    end(job, JobState::kSucceeded, "", "");
  } catch (const Error& error) {
    const bool stopped = error.code() == ErrorCode::kCancelled;
    if (stopped && !job.cancel_asked && is_stopping()) return leave(job, "is handed back");
    // What stands in the way is the store: another worker, or this one later, may do better.
    const bool is_idle = job.upload && job.upload->was_idle();
    if (error.code() == ErrorCode::kUnavailable && !is_idle) return leave(job, error.what());
    end(job, stopped ? JobState::kCancelled : JobState::kFailed,
        std::string(to_string(error.code())), error.what());
  } catch (const std::exception& error) {
    log_->error("{}: {}", name_of(job.record.id), error.what());
    end(job, JobState::kFailed, "internal", "A fault of the server; its log says more.");
  }
}

void JobQueue::carry_out(LiveJob& job, const IngestHooks& hooks) {
  const std::string name = name_of(job.record.id);
  const std::string& map = job.record.map;
  if (job.merge) {
    log_->info("{} merges map '{}' into map '{}'", name, job.merge->from, map);
    return run_merge(maps_, *job.store, map, *job.merge, job.stop.get_token(), hooks);
  }
  if (job.convert) {
    log_->info("{} converts map '{}' to {}", name, map, to_string(*job.convert));
    return run_convert(maps_, *job.store, map, *job.convert, job.stop.get_token(), hooks);
  }
  std::unique_ptr<ScanSource> opened;
  if (job.request.path) opened = open_request(job.request, options_.data_roots);
  ScanSource& source = opened ? *opened : *job.upload;
  log_->info("{} reads session '{}' into map '{}'", name, job.request.session, map);
  {
    const std::lock_guard lock(mutex_);
    job.record.scans_done = 0;
  }
  std::optional<SharedJob> shared;
  if (options_.shares_drives && job.request.path) {
    shared.emplace(SharedJob{parts_of(store_), job.claim, *log_});
  }
  run_ingest(maps_, *job.store, map, job.request, source, job.stop.get_token(), hooks, shared);
}

/// The job is not this server's any more: it goes on elsewhere, or here when it is claimed again.
void JobQueue::leave(LiveJob& job, const char* why) {
  log_->info("{}: {}", name_of(job.record.id), why);
  try {
    claims_.hand_back(job.claim);
  } catch (const Error&) {
    // Its lease ends then.
  }
  const std::lock_guard lock(mutex_);
  job.is_lost = true;
  drop(job);
}

void JobQueue::end(LiveJob& job, JobState state, const std::string& code,
                   const std::string& message) {
  JobRecord record;
  {
    const std::lock_guard lock(mutex_);
    record = job.record;
    if (job.is_lost) return log_->info("{} was taken over by another worker", name_of(record.id));
  }
  record.state = state;
  record.error_code = code;
  record.error_message = message;
  try {
    job.store->update_job(record);
    record = store_.job(record.id);
  } catch (const Error& error) {
    // Taken over, or the store is not to be reached: then its lease ends, and it is claimed again.
    log_->info("{} is left as it stands: {}", name_of(record.id), error.what());
    const std::lock_guard lock(mutex_);
    job.is_lost = true;
    return drop(job);
  }
  log_->info("{} is {}{}{}", name_of(record.id), to_string(state), message.empty() ? "" : ": ",
             message);
  metrics_.job_ended(std::string(to_string(state)));
  const std::lock_guard lock(mutex_);
  job.record = record;
  drop(job);
  has_news_ = true;  // the next job of the map
  news_.notify_all();
}

}  // namespace cellmap::server
