#pragma once

#include "server/api/json_io.hpp"
#include "server/jobs/job_queue.hpp"

namespace cellmap::server {

/// A job as the API tells it (openapi.yaml, Job).
Json to_json(const JobView& job);

}  // namespace cellmap::server
