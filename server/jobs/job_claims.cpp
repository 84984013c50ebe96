#include <unistd.h>

#include <algorithm>

#include "cellmap/core/error.hpp"
#include "server/jobs/convert.hpp"
#include "server/jobs/ingest.hpp"
#include "server/jobs/job_queue.hpp"
#include "server/jobs/live_job.hpp"

// How a JobQueue gets its jobs and keeps them.

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

/// How long another server's news may wait: a new job, a wish to cancel, a takeover.
constexpr std::chrono::milliseconds kLookForNews(1000);

}  // namespace

void JobQueue::keep_claiming() {
  const auto pause = std::min(kLookForNews, options_.lease / 3);
  bool was_well = true;
  std::unique_lock lock(mutex_);
  while (!stopping_) {
    lock.unlock();
    try {
      send_heartbeats();
      heed(claims_.unfinished_jobs());
      claim_what_may_run();
      was_well = true;
    } catch (const Error& error) {
      if (was_well) log_->error("cannot look for jobs: {}", error.what());
      was_well = false;
    }
    lock.lock();
    news_.wait_for(lock, pause, [&] { return stopping_ || has_news_; });
    has_news_ = false;
  }
}

void JobQueue::claim_what_may_run() {
  for (;;) {
    {
      const std::lock_guard lock(mutex_);
      if (stopping_ || live_.size() >= static_cast<std::size_t>(options_.workers)) return;
    }
    if (!claim_one(std::nullopt)) return;
  }
}

/// Null where there is nothing to claim. A job that this build cannot carry out ends here.
JobQueue::Job JobQueue::claim_one(std::optional<JobId> only) {
  const std::lock_guard claim_lock(claiming_);
  for (;;) {
    if (only) {
      if (Job job = live(*only)) return job;
    }
    const auto held = claims_.claim_job({.worker = worker_,
                                         .lease = options_.lease,
                                         .beside_others = options_.takes_scans,
                                         .only = only});
    if (!held) return nullptr;
    Job job;
    try {
      job = revive(*held);
    } catch (const Error& error) {
      if (error.code() == ErrorCode::kUnavailable) {
        claims_.hand_back({held->record.id, held->holder.claim});
        throw;
      }
      JobRecord record = held->record;
      record.state = JobState::kFailed;
      record.error_code = to_string(error.code());
      record.error_message = error.what();
      store_.update_job(record);
      log_->error("job {} cannot go on: {}", record.id.value, error.what());
      continue;
    }
    if (held->holder.claim > 1) {
      log_->info("job {} ({}) goes on here", job->record.id.value, job->record.map);
    }
    const std::lock_guard lock(mutex_);
    live_[job->record.id] = job;
    changed_.notify_all();
    return job;
  }
}

/// The job as it stands in the store, ready to go on.
JobQueue::Job JobQueue::revive(const HeldJob& held) const {
  auto job = std::make_shared<LiveJob>();
  job->record = held.record;
  job->record.state = JobState::kQueued;
  job->holder = held.holder;
  job->claim = {held.record.id, held.holder.claim};
  job->extended = Clock::now();
  job->cancel_asked = held.holder.cancel_asked;
  if (job->cancel_asked) job->stop.request_stop();
  job->store = claims_.fenced(job->claim);
  const Json request = parse_json(held.record.request_json);
  if (held.record.kind == kMergeKind) {
    job->merge = parse_merge_request(request);
    set_threads(job->merge->options, options_.threads);
  } else if (held.record.kind == kConvertKind) {
    job->convert = parse_convert_request(request);
  } else {
    job->request = parse_ingest_request(request);
    set_threads(job->request.options, options_.threads);
    if (job->request.path) return job;
    const auto resume = find_resume_point(store_, job->record.map, job->request.session);
    job->upload = std::make_unique<UploadSource>(job->request.scans_total,
                                                 resume ? resume->cell->first_scan : 0,
                                                 job->stop.get_token(), options_.upload);
  }
  return job;
}

/// A third of a lease after the last one, each in a transaction of its own.
void JobQueue::send_heartbeats() {
  std::vector<Job> due;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, job] : live_) {
      if (Clock::now() - job->extended >= options_.lease / 3) due.push_back(job);
    }
  }
  for (const Job& job : due) {
    const auto begun = Clock::now();
    const auto holder = claims_.extend_claim(job->claim, options_.lease);
    const std::lock_guard lock(mutex_);
    if (!holder) {
      lose(*job);
    } else {
      if (holder->lease_ends > job->holder.lease_ends) job->extended = begun;
      job->holder = *holder;
    }
  }
}

/// What other servers wrote about the jobs of this one.
void JobQueue::heed(const std::vector<HeldJob>& unfinished) {
  const std::lock_guard lock(mutex_);
  for (const HeldJob& held : unfinished) {
    const auto found = live_.find(held.record.id);
    if (found == live_.end()) continue;
    const Job job = found->second;
    if (held.holder.claim > job->claim.number) {
      lose(*job);
    } else if (held.holder.cancel_asked && !job->cancel_asked) {
      job->cancel_asked = true;
      job->stop.request_stop();
      touch(*job);
    }
  }
}

/// Under the mutex. The job is another worker's; the thread that carries it out stops.
void JobQueue::lose(LiveJob& job) {
  if (job.is_lost || is_final(job.record.state)) return;
  job.is_lost = true;
  job.stop.request_stop();
  drop(job);
}

/// Under the mutex. The same job may have been claimed here anew.
void JobQueue::drop(LiveJob& job) {
  const auto found = live_.find(job.record.id);
  if (found != live_.end() && found->second.get() == &job) live_.erase(found);
  touch(job);
}

}  // namespace cellmap::server
