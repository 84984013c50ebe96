#include "cellmap/store/sql_claims.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/sql_store.hpp"
#include "cellmap/store/sql_writes.hpp"
#include "cellmap/store/validation.hpp"

// Jobs of an SqlStore, and their claims. Jobs are numbered while nobody else writes: a job that is
// older than another one was seen by whoever claims that.

namespace cellmap {

JobRecord SqlStore::create_job(JobRecord job) {
  validate(job);
  job.created = job.updated = now();
  change_tables([&](SqlConnection& c) { job.id = insert_job(c, job); });
  return job;
}

void SqlStore::update_job(const JobRecord& job) {
  validate(job);
  JobRecord stamped = job;
  stamped.updated = now();
  database_->require_writable();
  database_->writers.change_rows([&](SqlConnection& c) {
    if (fence_) require_claim(c, *fence_);
    replace_job(c, stamped);
  });
  database_->owner.committed().notify();
}

JobRecord SqlStore::job(JobId id) const {
  return database_->readers.read([&](SqlConnection& c) { return read_job(c, id); });
}

std::vector<JobRecord> SqlStore::jobs(const std::optional<std::string>& map) const {
  return database_->readers.read([&](SqlConnection& c) { return read_jobs(c, map); });
}

JobRecord SqlStore::queue_job(JobRecord job, bool alone, const FindSame& find_same) {
  validate(job);
  job.created = job.updated = now();
  JobRecord queued;
  change_tables(
      [&](SqlConnection& c) { queued = insert_job_unless_same(c, job, alone, find_same); });
  return queued;
}

std::optional<HeldJob> SqlStore::claim_job(const ClaimWish& wish) {
  validate(wish);
  // Workers ask again and again, and mostly in vain.
  if (!database_->readers.read([&](SqlConnection& c) { return is_one_claimable(c, wish); })) {
    return std::nullopt;
  }
  std::optional<HeldJob> job;
  change_rows([&](SqlConnection& c) { job = claim_one_job(c, wish, now()); });
  return job;
}

std::optional<JobHolder> SqlStore::extend_claim(const JobClaim& claim,
                                                std::chrono::milliseconds lease) {
  std::optional<JobHolder> holder;
  change_rows([&](SqlConnection& c) { holder = cellmap::extend_claim(c, claim, lease); });
  return holder;
}

void SqlStore::hand_back(const JobClaim& claim) {
  change_rows([&](SqlConnection& c) { hand_back_claim(c, claim); });
}

JobRecord SqlStore::ask_to_cancel(JobId id) {
  JobRecord job;
  change_rows([&](SqlConnection& c) { job = cancel_or_ask(c, id, now()); });
  return job;
}

std::vector<HeldJob> SqlStore::unfinished_jobs(const std::optional<std::string>& map) const {
  return database_->readers.read([&](SqlConnection& c) { return read_unfinished_jobs(c, map); });
}

std::unique_ptr<Store> SqlStore::fenced(const JobClaim& claim) {
  return std::unique_ptr<SqlStore>(new SqlStore(database_, claim));
}

}  // namespace cellmap
