#include "cellmap/core/error.hpp"
#include "cellmap/core/hash.hpp"
#include "cellmap/store/sql_parts.hpp"
#include "cellmap/store/sql_store.hpp"
#include "cellmap/store/validation.hpp"

// The parts of jobs of an SqlStore.

namespace cellmap {
namespace {

Bytes checksum_of_part(const Bytes& made) {
  const ContentHash hash = sha256(made);
  const auto* begin = reinterpret_cast<const std::byte*>(hash.bytes.data());
  return Bytes(begin, begin + hash.bytes.size());
}

}  // namespace

Parts& parts_of(Store& store) {
  if (auto* parts = dynamic_cast<Parts*>(&store)) return *parts;
  throw Error(ErrorCode::kUnsupported, "this store shares no parts of jobs among workers");
}

void SqlStore::offer_parts(const std::vector<JobPart>& parts) {
  if (parts.empty()) return;
  change_passing_rows([&](SqlConnection& c) { insert_parts(c, parts); });
}

std::vector<JobPartState> SqlStore::offered_parts(const JobClaim& claim) const {
  return database_->readers.read([&](SqlConnection& c) { return read_parts(c, claim); });
}

bool SqlStore::retract_part(const JobPart& part) {
  bool retracted = false;
  change_passing_rows([&](SqlConnection& c) { retracted = retract_one_part(c, part); });
  return retracted;
}

std::optional<Bytes> SqlStore::collect_part(const JobPart& part) {
  std::optional<MadePart> made;
  change_passing_rows([&](SqlConnection& c) { made = remove_part(c, part); });
  if (!made) return std::nullopt;
  if (checksum_of_part(made->bytes) != made->checksum) {
    throw Error(ErrorCode::kCorruptData, "a part of job " + std::to_string(part.claim.job.value) +
                                             " was damaged in the store");
  }
  return std::move(made->bytes);
}

std::vector<JobId> SqlStore::jobs_with_parts() const {
  return database_->readers.read([](SqlConnection& c) { return read_jobs_with_parts(c); });
}

std::optional<JobPart> SqlStore::take_part(JobId job, const std::string& worker) {
  validate(ClaimWish{.worker = worker});
  std::optional<JobPart> part;
  change_passing_rows([&](SqlConnection& c) { part = take_one_part(c, job, worker); });
  return part;
}

bool SqlStore::deliver_part(const JobPart& part, const std::string& worker, const Bytes& made) {
  if (made.size() > kMaxPartBytes) {
    throw Error(ErrorCode::kTooLarge, "a part of a job has at most " +
                                          std::to_string(kMaxPartBytes) + " bytes, not " +
                                          std::to_string(made.size()));
  }
  bool delivered = false;
  const MadePart part_made{made, checksum_of_part(made)};
  change_passing_rows(
      [&](SqlConnection& c) { delivered = write_made_part(c, part, worker, part_made); });
  return delivered;
}

void SqlStore::give_back_part(const JobPart& part, const std::string& worker) {
  change_passing_rows([&](SqlConnection& c) { free_part(c, part, worker); });
}

}  // namespace cellmap
