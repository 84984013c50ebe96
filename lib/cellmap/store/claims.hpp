#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/store/store.hpp"

namespace cellmap {

/// Who carries out a job, and how long nobody else may. Times are the database's: clocks of
/// machines need not agree.
struct JobHolder {
  std::string worker;         ///< empty: nobody has claimed it, or it was handed back
  std::uint64_t claim = 0;    ///< how often it was claimed; a claim is void once this has risen
  Stamp lease_ends = 0;       ///< Unix time; from then on others may claim the job
  bool cancel_asked = false;  ///< whoever carries it out is to end it
};

/// An unfinished job.
struct HeldJob {
  JobRecord record;
  JobHolder holder;
};

/// What a worker shows with everything that it writes for a job.
struct JobClaim {
  JobId job;
  std::uint64_t number = 0;  ///< JobHolder::claim
};

/// What a worker would like to do.
struct ClaimWish {
  std::string worker;  ///< no two processes have the same name; at most 200 bytes
  std::chrono::milliseconds lease = std::chrono::seconds(15);
  bool beside_others = true;    ///< jobs too that need not be alone in their map
  std::optional<JobId> only{};  ///< no other job
};

/// How any number of workers share the jobs of one store. Each job has at most one valid claim. It
/// is good for a lease that heartbeats extend; when the lease has ended, because its worker is dead
/// or cut off, another one may claim the job, and from then on whatever the first still writes for
/// it is refused, in the transaction that would write it: a worker may be slow, but it cannot do
/// harm. An ended lease alone makes no claim void.
///
/// Jobs that are alone in their map (they move poses of recorded drives) are carried out one a map
/// at a time, in the order in which they came: the oldest unfinished one holds the lease of the
/// map, and no other one can be claimed before it has ended.
///
/// Durability, concurrency and errors as `Store`.
class Claims {
 public:
  virtual ~Claims() = default;

  /// Looks among the unfinished jobs for one that makes another needless; may throw to refuse.
  using FindSame = std::function<std::optional<JobId>(const std::vector<HeldJob>& unfinished)>;

  /// `Store::create_job` in one transaction with `find_same`: the job that it finds is returned
  /// instead, so that two servers that are asked for the same at the same time make one job.
  virtual JobRecord queue_job(JobRecord job, bool alone, const FindSame& find_same) = 0;

  /// Claims the oldest unfinished job whose lease has ended or that has none, and that may run;
  /// nullopt where there is none. Of several workers that ask at the same time one gets it.
  virtual std::optional<HeldJob> claim_job(const ClaimWish& wish) = 0;

  /// A heartbeat: the claim is good for another lease, or while its job is written. nullopt: void.
  virtual std::optional<JobHolder> extend_claim(const JobClaim& claim,
                                                std::chrono::milliseconds lease) = 0;

  /// The job is queued again and may be claimed at once. Does nothing where the claim is void.
  virtual void hand_back(const JobClaim& claim) = 0;

  /// Ends a job that nobody carries out as cancelled; else asks whoever does to end it, who learns
  /// it from the next heartbeat. Error{kConflict} where it has ended.
  virtual JobRecord ask_to_cancel(JobId id) = 0;

  /// Of one map, or all; by id.
  virtual std::vector<HeldJob> unfinished_jobs(
      const std::optional<std::string>& map = {}) const = 0;

  /// The same store for whoever holds a claim: every change through it is refused with
  /// Error{kConflict}, and changes nothing, once the claim is void. This store must outlive it.
  virtual std::unique_ptr<Store> fenced(const JobClaim& claim) = 0;
};

/// The claims of a store. Throws Error{kUnsupported} for an engine that has none.
Claims& claims_of(Store& store);

}  // namespace cellmap
