#include "cellmap/store/sql_parts.hpp"

namespace cellmap {
namespace {

constexpr const char* kThisPart = " WHERE job = ? AND claim = ? AND first_sequence = ?";

/// Parts that may be taken: what was offered under a claim that is void stays there for a moment.
std::string select_offered(const SqlConnection& connection, const char* columns) {
  return std::string("SELECT ") + columns +
         " FROM job_part WHERE worker = '' AND EXISTS (SELECT 1 FROM job WHERE job.id = "
         "job_part.job AND job.claim = job_part.claim AND job.worker <> '' AND job.lease_ends > " +
         connection.now_ns() + ")";
}

Bytes bytes_of(const Query& row, int column) {
  const auto bytes = row.bytes(column);
  return Bytes(bytes.begin(), bytes.end());
}

}  // namespace

void insert_parts(SqlConnection& connection, const std::vector<JobPart>& parts) {
  for (const JobPart& part : parts) {
    Query(connection,
          "INSERT INTO job_part (job, claim, first_sequence, first_scan, scan_count) SELECT id, "
          "claim, ?, ?, ? FROM job WHERE id = ? AND claim = ? AND worker <> '' "
          "ON CONFLICT (job, claim, first_sequence) DO NOTHING",
          part.first_sequence, part.first_scan, part.scan_count, part.claim.job.value,
          part.claim.number)
        .run();
  }
}

bool retract_one_part(SqlConnection& connection, const JobPart& part) {
  Query row(connection,
            std::string("DELETE FROM job_part") + kThisPart + " AND worker = '' RETURNING 1",
            part.claim.job.value, part.claim.number, part.first_sequence);
  if (!row.next()) return false;
  row.run();
  return true;
}

std::optional<MadePart> remove_part(SqlConnection& connection, const JobPart& part) {
  std::optional<MadePart> made;
  {
    Query row(
        connection,
        std::string("SELECT made, checksum FROM job_part") + kThisPart + connection.lock_rows(),
        part.claim.job.value, part.claim.number, part.first_sequence);
    if (!row.next()) return std::nullopt;
    if (!row.is_null(0)) made = MadePart{bytes_of(row, 0), bytes_of(row, 1)};
  }
  Query(connection, std::string("DELETE FROM job_part") + kThisPart, part.claim.job.value,
        part.claim.number, part.first_sequence)
      .run();
  return made;
}

std::optional<JobPart> take_one_part(SqlConnection& connection, JobId job,
                                     const std::string& worker) {
  JobPart part;
  {
    Query row(connection,
              select_offered(connection, "claim, first_sequence, first_scan, scan_count") +
                  " AND job = ? ORDER BY first_sequence LIMIT 1" + connection.lock_free_rows(),
              job.value);
    if (!row.next()) return std::nullopt;
    part = {{job, row.unsigned64(0)}, row.unsigned32(1), row.unsigned64(2), row.unsigned64(3)};
  }
  Query(connection, std::string("UPDATE job_part SET worker = ?") + kThisPart, worker, job.value,
        part.claim.number, part.first_sequence)
      .run();
  return part;
}

bool write_made_part(SqlConnection& connection, const JobPart& part, const std::string& worker,
                     const MadePart& made) {
  Query row(connection,
            std::string("UPDATE job_part SET made = ?, checksum = ?") + kThisPart +
                " AND worker = ? AND made IS NULL RETURNING 1",
            made.bytes, made.checksum, part.claim.job.value, part.claim.number, part.first_sequence,
            worker);
  if (!row.next()) return false;
  row.run();
  return true;
}

void free_part(SqlConnection& connection, const JobPart& part, const std::string& worker) {
  Query(connection,
        std::string("UPDATE job_part SET worker = ''") + kThisPart +
            " AND worker = ? AND made IS NULL",
        part.claim.job.value, part.claim.number, part.first_sequence, worker)
      .run();
}

std::vector<JobPartState> read_parts(SqlConnection& connection, const JobClaim& claim) {
  Query rows(connection,
             "SELECT first_sequence, worker, CASE WHEN made IS NULL THEN 0 ELSE 1 END FROM "
             "job_part WHERE job = ? AND claim = ? ORDER BY first_sequence",
             claim.job.value, claim.number);
  std::vector<JobPartState> parts;
  while (rows.next()) {
    parts.push_back({rows.unsigned32(0), rows.text(1), rows.integer(2) != 0});
  }
  return parts;
}

std::vector<JobId> read_jobs_with_parts(SqlConnection& connection) {
  Query rows(connection, select_offered(connection, "DISTINCT job") + " ORDER BY job");
  std::vector<JobId> jobs;
  while (rows.next()) jobs.push_back({rows.unsigned32(0)});
  return jobs;
}

void remove_parts(SqlConnection& connection, JobId job) {
  Query(connection, "DELETE FROM job_part WHERE job = ?", job.value).run();
}

}  // namespace cellmap
