#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/store/claims.hpp"

namespace cellmap {

/// A run of consecutive CELLs of the drive that a job reads, which any worker may make: what a CELL
/// becomes depends on its own scans alone.
struct JobPart {
  JobClaim claim;                    ///< of whoever carries out the job and offers the part
  std::uint32_t first_sequence = 0;  ///< of its first CELL; tells it from the job's other parts
  std::uint64_t first_scan = 0;
  std::uint64_t scan_count = 0;
};

/// What has become of a part that was offered.
struct JobPartState {
  std::uint32_t first_sequence = 0;
  std::string worker;  ///< who has taken it; empty: nobody
  bool is_made = false;
};

/// How workers make parts of each other's jobs. The holder of a job's claim offers parts, others
/// take and make them, and the holder collects them. Nothing here is more than a help: a part that
/// is lost, late or damaged is made by the holder, so there are no leases, and a part that was
/// taken is nobody else's but the holder's again. All parts of a job go when its claim ends, in
/// whichever way.
///
/// Concurrency and errors as `Store`; a part that is not there (any more) is no error. What is told
/// here may be lost with the machine, so that nobody waits for its disk.
class Parts {
 public:
  virtual ~Parts() = default;

  /// By the holder. Parts that are offered already are left alone; where the claim is void, nothing
  /// happens.
  virtual void offer_parts(const std::vector<JobPart>& parts) = 0;
  /// What is offered under this claim; by sequence.
  virtual std::vector<JobPartState> offered_parts(const JobClaim& claim) const = 0;
  /// Takes back an offer. False where somebody has taken it.
  virtual bool retract_part(const JobPart& part) = 0;
  /// Removes a part; its bytes where it was made. Error{kCorruptData} where they are damaged; it is
  /// removed then too.
  virtual std::optional<Bytes> collect_part(const JobPart& part) = 0;

  /// Jobs of which a part may be taken.
  virtual std::vector<JobId> jobs_with_parts() const = 0;
  /// Takes the first part of the job that nobody has taken; nullopt where there is none, or where
  /// the lease of the job has ended. Of several workers that ask at the same time one gets it.
  virtual std::optional<JobPart> take_part(JobId job, const std::string& worker) = 0;
  /// By whom `take_part` gave it; at most `kMaxPartBytes`, else Error{kTooLarge}. False where
  /// nobody waits for it any more.
  virtual bool deliver_part(const JobPart& part, const std::string& worker, const Bytes& made) = 0;
  /// Another worker may take it. Does nothing where it is not this one's.
  virtual void give_back_part(const JobPart& part, const std::string& worker) = 0;
};

constexpr std::size_t kMaxPartBytes = 64u << 20;

/// The parts of a store. Throws Error{kUnsupported} for an engine that has none.
Parts& parts_of(Store& store);

}  // namespace cellmap
