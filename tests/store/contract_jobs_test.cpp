#include <gmock/gmock.h>

#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

JobRecord ingest(const std::string& map) {
  JobRecord job;
  job.map = map;
  job.kind = "ingest";
  job.request_json = R"({"dataset": "a'b \" \u00e9 é"})";
  return job;
}

TEST_P(StoreContract, JobsAreNumberedStampedAndKept) {
  const JobRecord first = store_->create_job(ingest("town"));
  const JobRecord second = store_->create_job(ingest("town"));
  EXPECT_GT(first.id.value, 0u);
  EXPECT_LT(first.id, second.id);
  EXPECT_GT(first.created, 0);
  reopen();
  const JobRecord back = store_->job(first.id);
  EXPECT_EQ(back.map, "town");
  EXPECT_EQ(back.kind, "ingest");
  EXPECT_EQ(back.request_json, ingest("town").request_json);
  EXPECT_EQ(back.state, JobState::kQueued);
  EXPECT_EQ(back.created, first.created);
  EXPECT_EQ(back.started, 0);
}

TEST_P(StoreContract, AJobsProgressIsKept) {
  JobRecord job = store_->create_job(ingest("town"));
  job.state = JobState::kFailed;
  job.scans_done = 5;
  job.scans_total = 10;
  job.cells_done = 2;
  job.error_code = "io";
  job.error_message = "the disk's full";
  job.started = 123;
  store_->update_job(job);
  const JobRecord back = store_->job(job.id);
  EXPECT_EQ(back.state, JobState::kFailed);
  EXPECT_EQ(back.scans_done, 5u);
  EXPECT_EQ(back.scans_total, 10u);
  EXPECT_EQ(back.cells_done, 2u);
  EXPECT_EQ(back.error_code, "io");
  EXPECT_EQ(back.error_message, "the disk's full");
  EXPECT_EQ(back.started, 123);
  EXPECT_GE(back.updated, back.created);
}

TEST_P(StoreContract, JobsAreListedInOrderAndByMap) {
  const JobId a = store_->create_job(ingest("a")).id;
  const JobId b = store_->create_job(ingest("b")).id;
  const JobId c = store_->create_job(ingest("a")).id;
  const auto ids = [](const std::vector<JobRecord>& jobs) {
    std::vector<JobId> found;
    for (const JobRecord& job : jobs) found.push_back(job.id);
    return found;
  };
  EXPECT_EQ(ids(store_->jobs()), (std::vector<JobId>{a, b, c}));
  EXPECT_EQ(ids(store_->jobs("a")), (std::vector<JobId>{a, c}));
  EXPECT_TRUE(store_->jobs("none").empty());
}

TEST_P(StoreContract, JobsOutliveTheirMap) {
  store_->create_map("town", {});
  const JobId id = store_->create_job(ingest("town")).id;
  store_->delete_map("town");
  EXPECT_EQ(store_->job(id).map, "town");
}

TEST_P(StoreContract, UnknownAndMalformedJobsAreRefused) {
  expect_error(
      ErrorCode::kNotFound, [&] { store_->job({1}); }, "job 1");
  JobRecord job = ingest("town");
  job.id = {1};
  expect_error(
      ErrorCode::kNotFound, [&] { store_->update_job(job); }, "job 1");
  job = store_->create_job(job);
  job.map = "other";
  expect_error(
      ErrorCode::kConflict, [&] { store_->update_job(job); }, "cannot change");
  job = ingest("Not a name");
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->create_job(job); }, "map name");
  job = ingest("town");
  job.request_json.assign((1u << 20) + 1, ' ');
  expect_error(
      ErrorCode::kTooLarge, [&] { store_->create_job(job); }, "request");
  job = ingest("town");
  job.state = static_cast<JobState>(0);
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->create_job(job); }, "state");
}

TEST(JobState, NamesAreReadBack) {
  for (int state = 1; state <= 5; ++state) {
    const auto value = static_cast<JobState>(state);
    EXPECT_EQ(job_state_from_string(to_string(value)), value);
    EXPECT_EQ(is_final(value), state >= 3);
  }
  expect_error(
      ErrorCode::kCorruptData, [] { job_state_from_string("asleep"); }, "job state");
}

}  // namespace
}  // namespace cellmap::test
