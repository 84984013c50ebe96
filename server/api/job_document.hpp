#pragma once

#include "server/api/json_io.hpp"
#include "server/api/router.hpp"
#include "server/jobs/job_queue.hpp"

namespace cellmap::server {

/// A job as the API tells it (openapi.yaml, Job).
Json to_json(const JobView& job);

/// For the end of an upload: throws Error{kInvalidArgument} for a query `scans` that is no number;
/// the refusal where it is not the scan that is expected next, so that some are missing.
std::optional<Response> scans_missing(const Call& call,
                                      const std::optional<std::uint64_t>& next_scan);

}  // namespace cellmap::server
