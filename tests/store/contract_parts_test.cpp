#include <gmock/gmock.h>

#include <set>
#include <thread>

#include "store/parts_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

TEST_P(PartsContract, APartIsTakenMadeAndCollectedOnce) {
  const HeldJob job = holder_with_parts(2);
  EXPECT_EQ(parts().jobs_with_parts(), std::vector<JobId>{job.record.id});
  const auto taken = parts().take_part(job.record.id, "a");
  ASSERT_TRUE(taken);
  EXPECT_EQ(taken->claim.number, job.holder.claim);
  EXPECT_EQ(taken->first_sequence, 0u);
  EXPECT_EQ(taken->first_scan, 0u);
  EXPECT_EQ(taken->scan_count, 40u);
  auto states = parts().offered_parts(claim_of(job));
  ASSERT_EQ(states.size(), 2u);
  EXPECT_EQ(states[0].worker, "a");
  EXPECT_FALSE(states[0].is_made);
  EXPECT_EQ(states[1].worker, "");
  EXPECT_FALSE(parts().retract_part(*taken)) << "somebody is at it";
  const Bytes made = some_bytes(300'000);
  EXPECT_FALSE(parts().deliver_part(*taken, "b", made)) << "it is not b's";
  EXPECT_TRUE(parts().deliver_part(*taken, "a", made));
  EXPECT_FALSE(parts().deliver_part(*taken, "a", made)) << "again";
  parts().give_back_part(*taken, "a");  // too late
  EXPECT_TRUE(parts().offered_parts(claim_of(job))[0].is_made);
  EXPECT_EQ(parts().collect_part(*taken), made);
  EXPECT_EQ(parts().collect_part(*taken), std::nullopt);
  states = parts().offered_parts(claim_of(job));
  ASSERT_EQ(states.size(), 1u);
  EXPECT_EQ(states[0].first_sequence, 4u);
}

TEST_P(PartsContract, OfManyWorkersAtTheSameTimeEachPartHasOne) {
  constexpr std::uint32_t kParts = 24;
  const HeldJob job = holder_with_parts(kParts);
  std::vector<std::vector<std::uint32_t>> got(4);
  {
    std::vector<std::jthread> workers;
    for (std::size_t worker = 0; worker < got.size(); ++worker) {
      workers.emplace_back([&, worker] {
        // One that was just taken by another may be passed over, so nothing once is no end.
        for (int misses = 0; misses < 20;) {
          const auto sequence = taken(job, "worker" + std::to_string(worker));
          sequence ? got[worker].push_back(*sequence) : (void)++misses;
        }
      });
    }
  }
  std::multiset<std::uint32_t> all;
  for (const auto& sequences : got) all.insert(sequences.begin(), sequences.end());
  EXPECT_EQ(all.size(), kParts);
  EXPECT_EQ(std::set<std::uint32_t>(all.begin(), all.end()).size(), kParts);
  EXPECT_TRUE(parts().jobs_with_parts().empty());
}

TEST_P(PartsContract, WhatIsGivenBackIsTakenAgainAndWhatIsRetractedIsNot) {
  const HeldJob job = holder_with_parts(2);
  const auto first = parts().take_part(job.record.id, "a");
  parts().give_back_part(*first, "b");
  EXPECT_EQ(parts().offered_parts(claim_of(job))[0].worker, "a");
  parts().give_back_part(*first, "a");
  EXPECT_TRUE(parts().retract_part(part(job, 1)));
  EXPECT_FALSE(parts().retract_part(part(job, 1)));
  EXPECT_EQ(taken(job, "b"), 0u);
  EXPECT_EQ(taken(job, "b"), std::nullopt);
  EXPECT_FALSE(parts().deliver_part(*first, "a", some_bytes(3)));
  EXPECT_EQ(parts().collect_part(*first), std::nullopt)
      << "b had not made it, and makes it in vain";
  EXPECT_FALSE(parts().deliver_part(*first, "b", some_bytes(3)));
}

TEST_P(PartsContract, AnOfferThatIsRepeatedLeavesWhatCameOfTheFirst) {
  const HeldJob job = holder_with_parts(1);
  EXPECT_EQ(taken(job, "a"), 0u);
  offer(job, 2);
  EXPECT_EQ(parts().offered_parts(claim_of(job))[0].worker, "a");
  EXPECT_EQ(taken(job, "a"), 4u);
}

TEST_P(PartsContract, PartsGoWithTheClaimOfTheirJob) {
  const HeldJob job = holder_with_parts(2);
  const auto taken_part = parts().take_part(job.record.id, "a");
  claims().hand_back(claim_of(job));
  EXPECT_TRUE(parts().offered_parts(claim_of(job)).empty());
  EXPECT_FALSE(parts().deliver_part(*taken_part, "a", some_bytes(3)));

  const HeldJob again = *claim("holder");
  offer(again, 2);
  end(again);
  EXPECT_TRUE(parts().offered_parts(claim_of(again)).empty());

  const HeldJob silent = [&] {
    queue("village");
    return claim_and_fall_silent("holder");
  }();
  offer(silent, 2);
  EXPECT_TRUE(parts().jobs_with_parts().empty()) << "nobody waits for them";
  EXPECT_EQ(taken(silent, "a"), std::nullopt);
  const HeldJob taken_over = *claim("other");
  EXPECT_TRUE(parts().offered_parts(claim_of(silent)).empty());
  offer(silent, 1);  // it does not know yet
  EXPECT_TRUE(parts().offered_parts(claim_of(silent)).empty());
  EXPECT_EQ(taken(taken_over, "a"), std::nullopt);
  offer(taken_over, 1);
  EXPECT_EQ(parts().take_part(taken_over.record.id, "a")->claim.number, taken_over.holder.claim);
  end(taken_over);
  EXPECT_TRUE(parts().offered_parts(claim_of(silent)).empty());
}

TEST_P(PartsContract, AJobThatIsCancelledAfterItsWorkerFellSilentHasNoParts) {
  queue("town");
  const HeldJob job = claim_and_fall_silent("holder");
  offer(job, 2);
  claims().ask_to_cancel(job.record.id);
  EXPECT_TRUE(parts().offered_parts(claim_of(job)).empty());
}

TEST_P(PartsContract, ArgumentsAreChecked) {
  const HeldJob job = holder_with_parts(1);
  expect_error(
      ErrorCode::kInvalidArgument, [&] { parts().take_part(job.record.id, ""); }, "worker");
  const auto taken = parts().take_part(job.record.id, "a");
  expect_error(ErrorCode::kTooLarge,
               [&] { parts().deliver_part(*taken, "a", Bytes(kMaxPartBytes + 1)); });
  EXPECT_EQ(parts().take_part({4000}, "a"), std::nullopt);
  parts().offer_parts({});
}

}  // namespace
}  // namespace cellmap::test
