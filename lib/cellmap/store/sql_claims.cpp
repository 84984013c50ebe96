#include "cellmap/store/sql_claims.hpp"

#include "cellmap/core/error.hpp"
#include "cellmap/store/sql_parts.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/sql_writes.hpp"

namespace cellmap {
namespace {

// As the index `job_unfinished` has it.
constexpr const char* kUnfinished = "state IN ('queued', 'running')";

std::int64_t nanoseconds(std::chrono::milliseconds time) {
  return std::chrono::nanoseconds(time).count();
}

/// Selects the job to claim. Parameters: ClaimWish::only twice.
std::string select_claimable(const SqlConnection& connection, const ClaimWish& wish) {
  const std::string unfinished = kUnfinished;
  return "SELECT id FROM job WHERE " + unfinished + " AND lease_ends <= " + connection.now_ns() +
         " AND (alone = 0 OR NOT EXISTS (SELECT 1 FROM job AS older WHERE older.map = job.map "
         "AND older.alone = 1 AND older.id < job.id AND older." +
         unfinished + "))" + (wish.beside_others ? "" : " AND alone = 1") +
         " AND (id = ? OR CAST(? AS BIGINT) IS NULL) ORDER BY id LIMIT 1";
}

std::optional<std::uint64_t> only_of(const ClaimWish& wish) {
  return wish.only ? std::optional<std::uint64_t>(wish.only->value) : std::nullopt;
}

JobHolder holder_from_row(const Query& row, int column) {
  return {row.text(column), row.unsigned64(column + 1), row.integer(column + 2),
          row.integer(column + 3) != 0};
}

std::optional<JobHolder> valid_holder(SqlConnection& connection, const JobClaim& claim) {
  Query row(connection,
            std::string("SELECT worker, claim, lease_ends, cancel_asked FROM job WHERE id = ? AND "
                        "claim = ? AND worker <> '' AND ") +
                kUnfinished,
            claim.job.value, claim.number);
  return row.next() ? std::optional(holder_from_row(row, 0)) : std::nullopt;
}

HeldJob read_held_job(SqlConnection& connection, JobId id) {
  Query row(connection, "SELECT worker, claim, lease_ends, cancel_asked FROM job WHERE id = ?",
            id.value);
  if (!row.next()) return {read_job(connection, id), {}};  // says that it is not there
  return {read_job(connection, id), holder_from_row(row, 0)};
}

}  // namespace

JobRecord insert_job_unless_same(SqlConnection& connection, const JobRecord& job, bool alone,
                                 const Claims::FindSame& find_same) {
  if (const auto same = find_same(read_unfinished_jobs(connection, std::nullopt))) {
    return read_job(connection, *same);
  }
  JobRecord made = job;
  made.id = insert_job(connection, job);
  if (!alone) Query(connection, "UPDATE job SET alone = 0 WHERE id = ?", made.id.value).run();
  return made;
}

bool is_one_claimable(SqlConnection& connection, const ClaimWish& wish) {
  Query row(connection, select_claimable(connection, wish), only_of(wish), only_of(wish));
  return row.next();
}

std::optional<HeldJob> claim_one_job(SqlConnection& connection, const ClaimWish& wish, Stamp now) {
  JobId id;
  {
    // Who holds the lock of a row is claiming it, or writing for it: then it is not to be had.
    Query row(connection, select_claimable(connection, wish) + connection.lock_free_rows(),
              only_of(wish), only_of(wish));
    if (!row.next()) return std::nullopt;
    id = {row.unsigned32(0)};
  }
  Query(connection,
        "UPDATE job SET worker = ?, claim = claim + 1, lease_ends = " + connection.now_ns() +
            " + ?, updated = ? WHERE id = ?",
        wish.worker, nanoseconds(wish.lease), now, id.value)
      .run();
  remove_parts(connection, id);
  return read_held_job(connection, id);
}

std::optional<JobHolder> extend_claim(SqlConnection& connection, const JobClaim& claim,
                                      std::chrono::milliseconds lease) {
  {
    // Who writes for the job has its row: then nobody can take it over, and no other job's
    // heartbeat has to wait.
    Query row(connection, "SELECT id FROM job WHERE id = ?" + connection.lock_free_rows(),
              claim.job.value);
    if (!row.next()) return valid_holder(connection, claim);
  }
  Query row(connection,
            "UPDATE job SET lease_ends = " + connection.now_ns() +
                " + ? WHERE id = ? AND claim = ? AND worker <> '' AND " + kUnfinished +
                " RETURNING worker, claim, lease_ends, cancel_asked",
            nanoseconds(lease), claim.job.value, claim.number);
  if (!row.next()) return std::nullopt;
  const JobHolder holder = holder_from_row(row, 0);
  row.run();
  return holder;
}

void hand_back_claim(SqlConnection& connection, const JobClaim& claim) {
  Query row(connection,
            std::string("UPDATE job SET worker = '', lease_ends = 0, state = 'queued' WHERE id = ? "
                        "AND claim = ? AND ") +
                kUnfinished + " RETURNING 1",
            claim.job.value, claim.number);
  if (!row.next()) return;
  row.run();
  remove_parts(connection, claim.job);
}

JobRecord cancel_or_ask(SqlConnection& connection, JobId id, Stamp now) {
  bool is_at_work = false;
  {
    Query row(connection,
              "SELECT CASE WHEN lease_ends > " + connection.now_ns() +
                  " THEN 1 ELSE 0 END FROM job WHERE id = ?" + connection.lock_rows(),
              id.value);
    is_at_work = row.next() && row.integer(0) != 0;
  }
  JobRecord job = read_job(connection, id);
  if (is_final(job.state)) {
    throw Error(ErrorCode::kConflict,
                "The job has ended: it is " + std::string(to_string(job.state)) + ".");
  }
  if (is_at_work) {
    Query(connection, "UPDATE job SET cancel_asked = 1 WHERE id = ?", id.value).run();
    return job;
  }
  job.state = JobState::kCancelled;
  job.error_code = to_string(ErrorCode::kCancelled);
  job.error_message = "stopped at the caller's request";
  job.updated = now;
  replace_job(connection, job);
  // What a worker that was cut off still writes is void.
  Query(connection, "UPDATE job SET claim = claim + 1, worker = '' WHERE id = ?", id.value).run();
  return job;
}

std::vector<HeldJob> read_unfinished_jobs(SqlConnection& connection,
                                          const std::optional<std::string>& map) {
  const std::string sql = std::string(
                              "SELECT id, worker, claim, lease_ends, cancel_asked "
                              "FROM job WHERE ") +
                          kUnfinished + " AND (map = ? OR CAST(? AS TEXT) IS NULL) ORDER BY id";
  std::vector<HeldJob> jobs;
  {
    Query rows(connection, sql, map, map);
    while (rows.next()) {
      HeldJob& job = jobs.emplace_back();
      job.record.id = {rows.unsigned32(0)};
      job.holder = holder_from_row(rows, 1);
    }
  }
  for (HeldJob& job : jobs) job.record = read_job(connection, job.record.id);
  return jobs;
}

void require_claim(SqlConnection& connection, const JobClaim& claim) {
  Query row(connection, "SELECT claim, worker FROM job WHERE id = ?" + connection.lock_rows(),
            claim.job.value);
  if (row.next() && row.unsigned64(0) == claim.number && !row.text(1).empty()) return;
  throw Error(ErrorCode::kConflict, "job " + std::to_string(claim.job.value) +
                                        " was taken over by another worker; what this one still "
                                        "writes for it is refused");
}

void void_all_claims(SqlConnection& connection) {
  Query(connection,
        std::string("UPDATE job SET worker = '', lease_ends = 0 WHERE worker <> '' AND ") +
            kUnfinished)
      .run();
  Query(connection, "DELETE FROM job_part").run();
}

}  // namespace cellmap
