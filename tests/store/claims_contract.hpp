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

/// Unfinished jobs of the version of the schema before claims: a path, an upload, and a merge.
inline constexpr const char* kJobsOfSchema5 = R"sql(
    INSERT INTO job (map, kind, request, state, scans_done, scans_total, cells_done, error_code,
                     error_message, created, started, updated) VALUES
      ('town', 'ingest', '{"session":"a","path":"drive"}', 'running', 1, 2, 3, '', '', 4, 5, 6),
      ('town', 'ingest', '{"session":"b","upload":true}', 'queued', 0, 0, 0, '', '', 4, 0, 6),
      ('town', 'merge', '{"from":"other"}', 'queued', 0, 0, 0, '', '', 4, 0, 6),
      ('town', 'ingest', '{"session":"c","path":"drive"}', 'failed', 0, 0, 0, 'io', 'x', 4, 0, 6);
    )sql";

/// After the migration they may be claimed, by the same rules as new ones.
inline void expect_jobs_of_schema5(Store& store) {
  Claims& claims = claims_of(store);
  ASSERT_EQ(store.jobs().size(), 4u);
  EXPECT_EQ(store.jobs()[0].cells_done, 3u);
  ASSERT_EQ(claims.unfinished_jobs().size(), 3u);
  EXPECT_EQ(claims.claim_job({.worker = "a"})->record.kind, "ingest");
  const auto upload = claims.claim_job({.worker = "a"});
  ASSERT_TRUE(upload);
  EXPECT_EQ(upload->record.request_json, R"({"session":"b","upload":true})");
  EXPECT_EQ(upload->holder.claim, 1u);
  EXPECT_FALSE(claims.claim_job({.worker = "a"})) << "the merge waits for the path";
}

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
