#pragma once

#include "cellmap/store/parts.hpp"
#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

// Parts of jobs in SQL. Each function expects to run inside one transaction that may write. Those
// of `Parts` lock no row but the part's; what removes all parts of a job has the job's row locked,
// so that nobody waits in a circle.

void insert_parts(SqlConnection& connection, const std::vector<JobPart>& parts);
bool retract_one_part(SqlConnection& connection, const JobPart& part);
/// With its checksum.
struct MadePart {
  Bytes bytes, checksum;
};
std::optional<MadePart> remove_part(SqlConnection& connection, const JobPart& part);
std::optional<JobPart> take_one_part(SqlConnection& connection, JobId job,
                                     const std::string& worker);
bool write_made_part(SqlConnection& connection, const JobPart& part, const std::string& worker,
                     const MadePart& made);
void free_part(SqlConnection& connection, const JobPart& part, const std::string& worker);

/// These read only.
std::vector<JobPartState> read_parts(SqlConnection& connection, const JobClaim& claim);
std::vector<JobId> read_jobs_with_parts(SqlConnection& connection);

/// The claim of the job has ended.
void remove_parts(SqlConnection& connection, JobId job);

}  // namespace cellmap
