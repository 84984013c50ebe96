#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <stop_token>

#include "cellmap/store/claims.hpp"
#include "server/jobs/job_queue.hpp"

namespace cellmap::server {

inline constexpr const char* kIngestKind = "ingest";
inline constexpr const char* kMergeKind = "merge";
inline constexpr const char* kConvertKind = "convert";

/// A job that this server has claimed. Everything but what was asked for, `claim`, `store` and
/// `upload` is guarded by the queue's mutex.
struct JobQueue::LiveJob {
  JobRecord record;
  IngestRequest request;              ///< of an ingest
  std::optional<MergeRequest> merge;  ///< of a merge
  std::optional<CellForm> convert;    ///< of a conversion
  std::stop_source stop;
  std::unique_ptr<UploadSource> upload;  ///< of an ingest without a path
  JobClaim claim;
  std::unique_ptr<Store> store;  ///< what is written for the job goes through it
  JobHolder holder;
  bool cancel_asked = false;
  bool is_lost = false;  ///< another worker has it
  std::uint64_t version = 1;
  std::chrono::steady_clock::time_point started{}, extended{};
  std::uint64_t scans_at_start = 0;
};

}  // namespace cellmap::server
