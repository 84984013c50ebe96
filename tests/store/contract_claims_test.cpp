#include <gmock/gmock.h>

#include <set>
#include <thread>

#include "cellmap/store/documents.hpp"
#include "store/claims_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

TEST_P(ClaimsContract, AJobIsClaimedByOneWorkerAndSaysByWhomAndUntilWhen) {
  const JobId id = queue("town");
  EXPECT_EQ(claims().unfinished_jobs()[0].holder.worker, "");
  const auto job = claim("a");
  ASSERT_TRUE(job);
  EXPECT_EQ(job->record.id, id);
  EXPECT_EQ(job->holder.worker, "a");
  EXPECT_EQ(job->holder.claim, 1u);
  EXPECT_GT(job->holder.lease_ends, job->record.created);
  EXPECT_FALSE(claim("b"));
  EXPECT_FALSE(claim("a"));
  const HeldJob seen = claims().unfinished_jobs("town").at(0);
  EXPECT_EQ(seen.holder.worker, "a");
  EXPECT_EQ(seen.holder.lease_ends, job->holder.lease_ends);
  EXPECT_TRUE(claims().unfinished_jobs("other").empty());
}

TEST_P(ClaimsContract, OfManyClaimantsAtTheSameTimeEachJobHasOne) {
  constexpr int kJobs = 24, kWorkers = 6;
  for (int i = 0; i < kJobs; ++i) queue("town", false);
  std::vector<std::vector<JobId>> got(kWorkers);
  {
    std::vector<std::jthread> workers;
    for (int worker = 0; worker < kWorkers; ++worker) {
      workers.emplace_back([&, worker] {
        // One that was just taken by another may be passed over, so nothing once is no end.
        for (int misses = 0; misses < 20;) {
          const auto id = claimed("worker" + std::to_string(worker));
          id ? got[worker].push_back(*id) : (void)++misses;
        }
      });
    }
  }
  std::set<JobId> distinct;
  std::size_t all = 0;
  for (const auto& jobs : got) {
    distinct.insert(jobs.begin(), jobs.end());
    all += jobs.size();
  }
  EXPECT_EQ(all, kJobs);
  EXPECT_EQ(distinct.size(), kJobs);
  for (const HeldJob& job : claims().unfinished_jobs()) EXPECT_EQ(job.holder.claim, 1u);
}

TEST_P(ClaimsContract, AnEndedLeaseIsTakenOverOnce) {
  queue("town");
  const HeldJob first = claim_and_fall_silent("a");
  std::vector<HeldJob> taken;
  std::mutex mutex;
  {
    std::vector<std::jthread> workers;
    for (const char* worker : {"b", "c", "d"}) {
      workers.emplace_back([&, worker] {
        for (int i = 0; i < 10; ++i) {
          if (const auto job = claim(worker)) {
            const std::lock_guard lock(mutex);
            taken.push_back(*job);
          }
        }
      });
    }
  }
  ASSERT_EQ(taken.size(), 1u);
  EXPECT_EQ(taken[0].record.id, first.record.id);
  EXPECT_EQ(taken[0].holder.claim, first.holder.claim + 1);
}

TEST_P(ClaimsContract, WhatAWorkerWritesAfterATakeoverIsRefusedAndChangesNothing) {
  store_->create_map("town", {});
  queue("town");
  const HeldJob old = claim_and_fall_silent("a");
  const auto slow = claims().fenced(claim_of(old));
  slow->commit("town", adding({make_cell(1)}));  // nobody has taken over yet
  JobRecord record = old.record;
  record.cells_done = 1;
  slow->update_job(record);
  const HeldJob taken = *claim("b");
  SessionInfo other;
  other.name = "other";
  const auto refused = [](const std::function<void()>& write) {
    expect_error(ErrorCode::kConflict, write, "taken over");
  };
  refused([&] { slow->commit("town", adding({make_cell(2)})); });
  refused([&] { slow->commit("town", moving({{CellId{1}, pose_at(3, 0)}})); });
  record.state = JobState::kFailed;
  refused([&] { slow->update_job(record); });
  refused([&] { documents_of(*slow).put_document("town", "note", "x"); });
  refused([&] { slow->set_form("town", compact_form(0.02)); });
  refused([&] { slow->create_session("town", other); });
  refused([&] { slow->delete_map("town"); });
  EXPECT_FALSE(claims().extend_claim(claim_of(old), kLong));
  claims().hand_back(claim_of(old));
  EXPECT_EQ(store_->version("town").revision, 1u);
  EXPECT_EQ(store_->map("town").cells, 1u);
  EXPECT_TRUE(store_->cell("town", {1}).T_map_cell.isApprox(Pose::Identity()));
  EXPECT_FALSE(documents_of(*store_).document("town", "note"));
  EXPECT_EQ(store_->job(old.record.id).cells_done, 1u);
  EXPECT_EQ(store_->job(old.record.id).state, JobState::kQueued);
  EXPECT_EQ(claims().unfinished_jobs()[0].holder.worker, "b");
  claims().fenced(claim_of(taken))->commit("town", adding({make_cell(2)}));
  EXPECT_EQ(slow->map("town").cells, 2u) << "it may still read";
}

TEST_P(ClaimsContract, AFencedWriteDoesNotSpoilThoseThatShareItsTransaction) {
  store_->create_map("town", {});
  queue("town");
  const HeldJob old = claim_and_fall_silent("a");
  const auto slow = claims().fenced(claim_of(old));
  ASSERT_TRUE(claim("b"));
  std::vector<std::jthread> writers;
  for (std::uint32_t i = 1; i <= 8; ++i) {
    writers.emplace_back([&, i] { store_->commit("town", adding({make_cell(i)})); });
    writers.emplace_back([&, i] {
      expect_error(ErrorCode::kConflict,
                   [&] { slow->commit("town", adding({make_cell(100 + i)})); });
    });
  }
  writers.clear();
  EXPECT_EQ(store_->map("town").cells, 8u);
}

TEST_P(ClaimsContract, AHeartbeatKeepsAClaimEvenAfterItsLeaseHasEnded) {
  queue("town");
  const HeldJob job = claim_and_fall_silent("a");
  const auto kept = claims().extend_claim(claim_of(job), kLong);
  ASSERT_TRUE(kept);
  EXPECT_EQ(kept->claim, job.holder.claim);
  EXPECT_GT(kept->lease_ends, job.holder.lease_ends);
  EXPECT_FALSE(claim("b"));
}

TEST_P(ClaimsContract, AJobThatIsHandedBackIsClaimedAtOnceAndItsOldClaimIsVoid) {
  store_->create_map("town", {});
  queue("town");
  const HeldJob job = *claim("a");
  claims().hand_back(claim_of(job));
  EXPECT_FALSE(claims().extend_claim(claim_of(job), kLong));
  expect_error(ErrorCode::kConflict,
               [&] { claims().fenced(claim_of(job))->commit("town", adding({make_cell(1)})); });
  EXPECT_EQ(claim("b")->holder.claim, 2u);
}

TEST_P(ClaimsContract, AJobThatIsAloneInItsMapWaitsForTheOlderOnesAndOthersAreTakenInstead) {
  const JobId first = queue("town"), second = queue("town"), upload = queue("town", false),
              elsewhere = queue("village");
  const HeldJob running = *claim("a");
  EXPECT_EQ(running.record.id, first);
  EXPECT_EQ(claimed("b"), upload);
  EXPECT_EQ(claimed("b"), elsewhere);
  EXPECT_EQ(claimed("b"), std::nullopt);
  end(running);
  EXPECT_EQ(claimed("b"), second);
}

TEST_P(ClaimsContract, TheLeaseOfAMapOutlivesItsDeadHolderUntilTheJobIsTakenOverAndEnded) {
  const JobId first = queue("town"), second = queue("town");
  claim_and_fall_silent("a");
  EXPECT_EQ(claims().claim_job({.worker = "b", .only = second}), std::nullopt);
  const HeldJob taken = *claim("b");
  EXPECT_EQ(taken.record.id, first);
  EXPECT_EQ(claimed("c"), std::nullopt);
  end(taken);
  EXPECT_EQ(claimed("c"), second);
}

TEST_P(ClaimsContract, AWorkerMayWishForOneJobOrForThoseOfRecordedDrives) {
  const JobId upload = queue("town", false), recorded = queue("town");
  EXPECT_EQ(claims().claim_job({.worker = "a", .beside_others = false})->record.id, recorded);
  EXPECT_FALSE(claims().claim_job({.worker = "a", .beside_others = false}));
  EXPECT_FALSE(claims().claim_job({.worker = "a", .only = JobId{4000}}));
  EXPECT_EQ(claims().claim_job({.worker = "a", .only = upload})->record.id, upload);
}

TEST_P(ClaimsContract, EndedJobsAreNotClaimed) {
  queue("town");
  const HeldJob job = claim_and_fall_silent("a");
  end(job);
  EXPECT_FALSE(claim("b"));
  EXPECT_FALSE(claims().extend_claim(claim_of(job), kLong));
  EXPECT_TRUE(claims().unfinished_jobs().empty());
  claims().hand_back(claim_of(job));
  EXPECT_EQ(store_->job(job.record.id).state, JobState::kSucceeded);
}

TEST_P(ClaimsContract, WhoeverWorksIsAskedToCancelAndWhatNobodyWorksAtEndsAtOnce) {
  const JobId running = queue("town"), waiting = queue("town");
  const HeldJob job = *claim("a");
  EXPECT_FALSE(is_final(claims().ask_to_cancel(running).state));
  EXPECT_TRUE(claims().extend_claim(claim_of(job), kLong)->cancel_asked);
  EXPECT_EQ(claims().ask_to_cancel(waiting).state, JobState::kCancelled);
  EXPECT_EQ(store_->job(waiting).state, JobState::kCancelled);
  EXPECT_EQ(store_->job(waiting).error_code, "cancelled");
  expect_error(
      ErrorCode::kConflict, [&] { claims().ask_to_cancel(waiting); }, "has ended");
  expect_error(ErrorCode::kNotFound, [&] { claims().ask_to_cancel({4000}); });
}

TEST_P(ClaimsContract, AJobThatWasCancelledAfterItsWorkerFellSilentIsWrittenForNoMore) {
  store_->create_map("town", {});
  queue("town");
  const HeldJob job = claim_and_fall_silent("a");
  EXPECT_EQ(claims().ask_to_cancel(job.record.id).state, JobState::kCancelled);
  EXPECT_FALSE(claims().extend_claim(claim_of(job), kLong));
  expect_error(ErrorCode::kConflict,
               [&] { claims().fenced(claim_of(job))->commit("town", adding({make_cell(1)})); });
}

TEST_P(ClaimsContract, WhoAsksForTheSameAtTheSameTimeGetsTheSameJob) {
  const auto same = [](const std::vector<HeldJob>& unfinished) -> std::optional<JobId> {
    for (const HeldJob& job : unfinished) {
      if (job.record.map == "town") return job.record.id;
    }
    return std::nullopt;
  };
  queue("village");
  std::vector<JobId> made(6);
  std::vector<std::jthread> askers;
  for (JobId& id : made) {
    askers.emplace_back([&] {
      JobRecord job;
      job.map = "town";
      job.kind = "ingest";
      id = claims().queue_job(job, true, same).id;
    });
  }
  askers.clear();
  EXPECT_THAT(made, ::testing::Each(made.front()));
  EXPECT_EQ(store_->jobs("town").size(), 1u);
  JobRecord refused;
  refused.map = "other";
  refused.kind = "ingest";
  const auto full = [](const std::vector<HeldJob>&) -> std::optional<JobId> {
    throw Error(ErrorCode::kUnavailable, "full");
  };
  expect_error(ErrorCode::kUnavailable, [&] { claims().queue_job(refused, true, full); });
  EXPECT_TRUE(store_->jobs("other").empty());
}

TEST_P(ClaimsContract, WishesAreChecked) {
  expect_error(
      ErrorCode::kInvalidArgument, [&] { claim(""); }, "worker");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { claim("a", milliseconds(0)); }, "lease");
}

}  // namespace
}  // namespace cellmap::test
