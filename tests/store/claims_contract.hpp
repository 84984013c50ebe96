#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "cellmap/store/claims.hpp"
#include "store/store_contract.hpp"

namespace cellmap::test {

using std::chrono::milliseconds;

inline constexpr milliseconds kLong = std::chrono::hours(1), kShort{1};

inline std::optional<JobId> nothing_same(const std::vector<HeldJob>&) { return std::nullopt; }

inline JobClaim claim_of(const HeldJob& job) { return {job.record.id, job.holder.claim}; }

/// What every engine must do for workers that share its jobs; an engine joins as above.
class ClaimsContract : public StoreContract {
 protected:
  Claims& claims() { return claims_of(*store_); }

  JobId queue(const std::string& map, bool alone = true) {
    JobRecord job;
    job.map = map;
    job.kind = "ingest";
    job.request_json = "{}";
    return claims().queue_job(job, alone, nothing_same).id;
  }
  std::optional<HeldJob> claim(const std::string& worker, milliseconds lease = kLong) {
    return claims().claim_job({.worker = worker, .lease = lease});
  }
  std::optional<JobId> claimed(const std::string& worker) {
    const auto job = claim(worker);
    return job ? std::optional(job->record.id) : std::nullopt;
  }
  /// Claims the one job that there is for so short that its lease has ended when this returns.
  HeldJob claim_and_fall_silent(const std::string& worker) {
    const HeldJob job = *claim(worker, kShort);
    std::this_thread::sleep_for(milliseconds(20));
    return job;
  }
  void end(const HeldJob& job) {
    JobRecord record = job.record;
    record.state = JobState::kSucceeded;
    claims().fenced(claim_of(job))->update_job(record);
  }
};

}  // namespace cellmap::test
