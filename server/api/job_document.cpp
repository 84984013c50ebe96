#include "server/api/job_document.hpp"

#include <algorithm>

#include "server/api/problem.hpp"

namespace cellmap::server {
namespace {

template <typename T>
Json number_or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json();
}

}  // namespace

Json to_json(const JobView& job) {
  const auto& record = job.record;
  Json progress, error;
  if (record.state == JobState::kSucceeded) {
    progress = 1.0;
  } else if (record.scans_total > 0) {
    progress = std::min(
        1.0, static_cast<double>(record.scans_done) / static_cast<double>(record.scans_total));
  }
  if (!record.error_code.empty()) {
    error = {{"code", record.error_code}, {"message", record.error_message}};
  }
  Json worker, lease_ends;
  if (job.holder && !job.holder->worker.empty()) {
    worker = job.holder->worker;
    lease_ends = to_rfc3339(job.holder->lease_ends);
  }
  return {{"id", record.id.value},
          {"map", record.map},
          {"kind", record.kind},
          {"state", to_string(record.state)},
          {"session", job.session.empty() ? Json() : Json(job.session)},
          {"scans_done", record.scans_done},
          {"scans_total", record.scans_total},
          {"cells_done", record.cells_done},
          {"progress", progress},
          {"scans_per_second", job.scans_per_second},
          {"eta_s", number_or_null(job.eta_s)},
          {"next_scan", number_or_null(job.next_scan)},
          {"worker", worker},
          {"lease_ends", lease_ends},
          {"error", error},
          {"created", to_rfc3339(record.created)},
          {"updated", to_rfc3339(std::max(record.updated, record.created))}};
}

std::optional<Response> scans_missing(const Call& call,
                                      const std::optional<std::uint64_t>& next_scan) {
  const auto scans = call.query_integer("scans", 0, UINT64_MAX);
  if (!scans || !next_scan || *scans == *next_scan) return std::nullopt;
  return problem(ErrorCode::kConflict,
                 "The drive has " + std::to_string(*scans) + " scans; send them from scan " +
                     std::to_string(*next_scan) + " on.",
                 next_scan);
}

}  // namespace cellmap::server
