#pragma once

#include "cellmap/store/claims.hpp"
#include "cellmap/store/sql_connection.hpp"

namespace cellmap {

// Claims in SQL. Each function expects to run inside one transaction that may write; what says so
// needs only the locks of the rows that it reads (SqlConnection::begin_row_write).

/// `job` has been validated and stamped.
JobRecord insert_job_unless_same(SqlConnection& connection, const JobRecord& job, bool alone,
                                 const Claims::FindSame& find_same);

/// Row locks are enough for these four, each of which locks one job at most.
std::optional<HeldJob> claim_one_job(SqlConnection& connection, const ClaimWish& wish, Stamp now);
std::optional<JobHolder> extend_claim(SqlConnection& connection, const JobClaim& claim,
                                      std::chrono::milliseconds lease);
void hand_back_claim(SqlConnection& connection, const JobClaim& claim);
JobRecord cancel_or_ask(SqlConnection& connection, JobId id, Stamp now);

/// Whether `claim_one_job` would find one; reads only.
bool is_one_claimable(SqlConnection& connection, const ClaimWish& wish);

/// By id; reads only.
std::vector<HeldJob> read_unfinished_jobs(SqlConnection& connection,
                                          const std::optional<std::string>& map);

/// Error{kConflict} where the claim is void; else it stays valid until the transaction ends.
void require_claim(SqlConnection& connection, const JobClaim& claim);

/// For an engine that knows that no other process works on its jobs.
void void_all_claims(SqlConnection& connection);

}  // namespace cellmap
