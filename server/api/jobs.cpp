#include <thread>

#include "cellmap/codec/scan_codec.hpp"
#include "cellmap/core/error.hpp"
#include "server/api/access.hpp"
#include "server/api/api.hpp"
#include "server/api/follower.hpp"
#include "server/api/job_document.hpp"
#include "server/api/media_types.hpp"
#include "server/api/problem.hpp"

// /v1/maps/{map}/jobs, /v1/maps/{map}/merge, /v1/maps/{map}/convert and /v1/jobs/{job} with events,
// scans and complete.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxJobBody = 64u << 10;
constexpr std::size_t kMaxScanBody = 33u << 20;

JobId job_id(const Call& call) { return JobId{call.path_id("job")}; }

Response list_jobs(Services& services, const Call& call) {
  Json jobs = Json::array();
  for (const auto& job : services.jobs.jobs(call.path("map"))) jobs.push_back(to_json(job));
  return json_response({{"jobs", std::move(jobs)}});
}

Response create_job(Services& services, const Call& call) {
  validate_map_name(call.path("map"));
  const JobView job = services.jobs.submit(call.path("map"), call.json());
  Response response = json_response(to_json(job), 202);
  response.headers.set("Location", "/v1/jobs/" + std::to_string(job.record.id.value));
  return response;
}

Response create_merge(Services& services, const Call& call) {
  const Json request = call.json();
  if (request.is_object() && request.contains("from") && request["from"].is_string()) {
    const auto from = request["from"].get<std::string>();
    if (!call.may_use(from)) return map_refused(from);
  }
  const JobView job = services.jobs.submit_merge(call.path("map"), request);
  Response response = json_response(to_json(job), 202);
  response.headers.set("Location", "/v1/jobs/" + std::to_string(job.record.id.value));
  return response;
}

Response create_convert(Services& services, const Call& call) {
  const JobView job = services.jobs.submit_convert(call.path("map"), call.json());
  Response response = json_response(to_json(job), 202);
  response.headers.set("Location", "/v1/jobs/" + std::to_string(job.record.id.value));
  return response;
}

Response put_scan(Services& services, const Call& call) {
  const JobId id = job_id(call);
  const std::uint32_t index = call.path_id("index");
  services.jobs.job(id);  // throws where there is none
  call.content_type({kScanType});
  PosedScan scan = decode_scan(as_bytes(call.content(kMaxScanBody)));
  scan.index = index;
  const auto put = services.jobs.put_scan(id, std::move(scan));
  const auto expected = services.jobs.job(id).next_scan;
  switch (put) {
    case UploadSource::Put::kTaken:
    case UploadSource::Put::kHadAlready:
      break;
    case UploadSource::Put::kOutOfOrder:
      return problem(ErrorCode::kConflict,
                     "Scans come in order: expected scan " + std::to_string(*expected) +
                         ", found " + std::to_string(index) + ".",
                     expected);
    case UploadSource::Put::kFull:
      return problem(ErrorCode::kUnavailable, "The job works on earlier scans; send it again.",
                     expected);
    case UploadSource::Put::kEnded:
      return problem(ErrorCode::kConflict, "The upload was completed; no scan can follow.",
                     expected);
  }
  Response response;
  response.status = 204;
  return response;
}

Response complete_job(Services& services, const Call& call) {
  const JobId id = job_id(call);
  if (auto refused = scans_missing(call, services.jobs.job(id).next_scan)) {
    return *std::move(refused);
  }
  return json_response(to_json(services.jobs.complete(id)), 202);
}

/// The stream of one follower: its state between two pieces.
class Events {
 public:
  Events(Services& services, JobId id) : services_(services), follower_(services), id_(id) {}

  bool next(std::string& chunk) {
    std::this_thread::sleep_until(last_ + kShortestEventInterval);
    const JobView job = services_.jobs.wait(id_, seen_, services_.options.heartbeat);
    last_ = std::chrono::steady_clock::now();
    if (is_final(job.record.state)) {
      chunk += "event: end\ndata: " + dump(to_json(job)) + "\n\n";
      return false;
    }
    if (services_.jobs.is_stopping()) return false;
    if (job.version == seen_) {
      chunk += ": still here\n\n";
    } else {
      chunk += "event: progress\ndata: " + dump(to_json(job)) + "\n\n";
    }
    seen_ = job.version;
    return true;
  }

 private:
  Services& services_;
  Follower follower_;
  JobId id_;
  std::uint64_t seen_ = 0;
  std::chrono::steady_clock::time_point last_{};
};

Response job_events(Services& services, const Call& call) {
  const JobId id = job_id(call);
  services.jobs.job(id);
  Response response;
  response.headers.set("Content-Type", "text/event-stream");
  response.headers.set("Cache-Control", "no-store");
  if (call.method() == "HEAD") return response;
  response.body = [events = std::make_shared<Events>(services, id)](std::string& chunk) {
    return events->next(chunk);
  };
  return response;
}

}  // namespace

void add_job_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  const std::string of_map = "/v1/maps/{map}/jobs", one = "/v1/jobs/{job}";
  router.add(
      {"GET", of_map, {}, 0, json, [&](const Call& call) { return list_jobs(services, call); }});
  router.add({"POST", of_map, {}, kMaxJobBody, json, [&](const Call& call) {
                return create_job(services, call);
              }});
  router.add({"POST", "/v1/maps/{map}/convert", {}, kMaxJobBody, json, [&](const Call& call) {
                return create_convert(services, call);
              }});
  router.add({"POST", "/v1/maps/{map}/merge", {}, kMaxJobBody, json, [&](const Call& call) {
                return create_merge(services, call);
              }});
  router.add({"GET", one, {}, 0, json, [&](const Call& call) {
                return json_response(to_json(services.jobs.job(job_id(call))));
              }});
  router.add({"DELETE", one, {}, 0, json, [&](const Call& call) {
                return json_response(to_json(services.jobs.cancel(job_id(call))), 202);
              }});
  router.add({"GET",
              one + "/events",
              {},
              0,
              {"text/event-stream"},
              [&](const Call& call) { return job_events(services, call); },
              true});
  router.add({"PUT", one + "/scans/{index}", {}, kMaxScanBody, {}, [&](const Call& call) {
                return put_scan(services, call);
              }});
  router.add({"POST", one + "/complete", {"scans"}, 1024, json, [&](const Call& call) {
                return complete_job(services, call);
              }});
}

}  // namespace cellmap::server
