#include <algorithm>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/scan_batch.hpp"
#include "cellmap/core/error.hpp"
#include "server/api/api.hpp"
#include "server/api/job_document.hpp"
#include "server/api/media_types.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"
#include "server/jobs/ingest.hpp"

// /v1/maps/{map}/sessions/{session}/scans and scans:complete: a robot maps live. There is one way
// in for scans, the upload job; this finds or makes the session's.

namespace cellmap::server {
namespace {

enum class State {
  kNew,        // nothing of the session is there
  kMapping,    // a job takes its scans
  kFinishing,  // its drive has ended, a job works on what was sent
  kPaused,     // the next scan makes a job
  kStopped,    // somebody cancelled its job, or the job failed: whoever knows why posts another
  kEnded,      // its drive has ended, and is in the map
};

const char* to_string(State state) {
  switch (state) {
    case State::kNew:
      return "new";
    case State::kMapping:
      return "mapping";
    case State::kFinishing:
      return "finishing";
    case State::kPaused:
      return "paused";
    case State::kStopped:
      return "stopped";
    case State::kEnded:
      break;
  }
  return "ended";
}

/// How far the server is with a session.
struct Standing {
  State state = State::kNew;
  std::optional<JobView> job;              // the unfinished one, else the last
  std::optional<std::uint64_t> next_scan;  // not known where a job reads a path
  std::uint64_t keep_from = 0;             // no earlier scan will be asked for again
  std::size_t room = 0;                    // scans that would be taken without waiting
};

State state_of(const JobView& job) {
  switch (job.record.state) {
    case JobState::kQueued:
    case JobState::kRunning:
      return job.completed ? State::kFinishing : State::kMapping;
    case JobState::kSucceeded:
      return State::kEnded;
    case JobState::kFailed:
      // No scan came for long: that is how a robot rests.
      if (job.record.error_code == cellmap::to_string(ErrorCode::kUnavailable)) {
        return State::kPaused;
      }
      [[fallthrough]];
    case JobState::kCancelled:
      return State::kStopped;
  }
  return State::kStopped;
}

Standing standing_of(const Services& services, const std::string& map, const std::string& session) {
  if (!is_session_name(session)) {
    throw Error(ErrorCode::kInvalidArgument,
                "A session is named by 1 to 64 characters [A-Za-z0-9._-], found " +
                    in_quotes(session) + ".");
  }
  Standing standing;
  standing.job = services.jobs.latest_job(map, session);
  const auto last = find_resume_point(services.store, map, session);
  // The CELLs of an earlier job may have been moved elsewhere or deleted since.
  const bool job_left_cells = standing.job && standing.job->record.cells_done > 0;
  const bool is_over = standing.job && is_final(standing.job->record.state);
  if (is_over && job_left_cells && !last) standing.job.reset();
  if (standing.job) {
    standing.state = state_of(*standing.job);
  } else if (last) {
    standing.state = State::kPaused;
  }
  standing.keep_from = last ? last->cell->first_scan : 0;
  standing.next_scan = standing.keep_from;  // a CELL's base scan is read again to go on after it
  if (standing.state == State::kEnded) {
    standing.next_scan = standing.keep_from = last ? last->next_scan() : 0;
  } else if (standing.job && !is_over) {
    standing.next_scan = standing.job->next_scan;
    standing.room = standing.job->room;
  } else if (standing.state != State::kStopped) {
    standing.room = services.options.jobs.upload.max_scans;  // of the job that a scan makes
  }
  return standing;
}

Json document(const std::string& session, const Standing& standing) {
  Json next_scan, job;
  if (standing.next_scan) next_scan = *standing.next_scan;
  if (standing.job) job = to_json(*standing.job);
  return {{"session", session},
          {"state", to_string(standing.state)},
          {"next_scan", std::move(next_scan)},
          {"keep_from", standing.keep_from},
          {"room", standing.room},
          {"job", std::move(job)}};
}

Response get_scans(Services& services, const Call& call) {
  const auto& map = call.path("map");
  services.store.version(map);  // throws where there is no such map
  const auto& session = call.path("session");
  return json_response(document(session, standing_of(services, map, session)));
}

/// As the job before was asked, so that a drive is not mapped in two ways.
JobView make_upload(Services& services, const std::string& map, const std::string& session,
                    const Standing& standing) {
  Json request = Json::object();
  if (standing.job) request = parse_json(standing.job->record.request_json);
  for (const char* const key : {"path", "poses", "pose_frame", "create_map", "lattice"}) {
    request.erase(key);
  }
  request["kind"] = "ingest";
  request["session"] = session;
  request["upload"] = true;
  return services.jobs.submit(map, request);
}

[[noreturn]] void refuse_stopped(const Standing& standing) {
  const JobRecord& job = standing.job->record;
  throw Error(ErrorCode::kConflict, "The session's job " + std::to_string(job.id.value) + " is " +
                                        std::string(cellmap::to_string(job.state)) + " (" +
                                        job.error_message +
                                        "); post a job of the session to the map's jobs to go on.");
}

[[noreturn]] void refuse_path(const Standing& standing) {
  throw Error(ErrorCode::kConflict, "The session is being read from a path by job " +
                                        std::to_string(standing.job->record.id.value) +
                                        "; wait for it or cancel it.");
}

std::vector<PosedScan> scans_of(const Call& call) {
  const std::string type = call.content_type({kScanType, kScansType});
  const std::string body = call.content(kMaxScanBatchBytes);
  if (type == kScansType) return decode_scan_batch(as_bytes(body));
  std::vector<PosedScan> scans;
  scans.push_back(decode_scan(as_bytes(body)));
  return scans;
}

/// What became of the scans of one request.
struct Taken {
  std::uint64_t scans = 0;
  UploadSource::Put last = UploadSource::Put::kHadAlready;
};

/// In order, until one is refused.
Taken put_scans(Services& services, JobId job, std::vector<PosedScan> scans) {
  Taken taken;
  for (PosedScan& scan : scans) {
    taken.last = services.jobs.put_scan(job, std::move(scan));
    if (taken.last == UploadSource::Put::kTaken) ++taken.scans;
    if (taken.last != UploadSource::Put::kTaken && taken.last != UploadSource::Put::kHadAlready) {
      break;
    }
  }
  return taken;
}

/// Why no scan of a request was taken; nullopt where that is as it should be.
std::optional<Response> refusal(UploadSource::Put last, std::uint64_t first,
                                const Standing& standing) {
  switch (last) {
    case UploadSource::Put::kTaken:
    case UploadSource::Put::kHadAlready:
      return std::nullopt;
    case UploadSource::Put::kOutOfOrder:
      return problem(ErrorCode::kConflict,
                     "Scans come in order: expected scan " + std::to_string(*standing.next_scan) +
                         ", found " + std::to_string(first) + ".",
                     standing.next_scan);
    case UploadSource::Put::kFull:
      return problem(ErrorCode::kUnavailable, "The job works on earlier scans; send these again.",
                     standing.next_scan);
    case UploadSource::Put::kEnded:
      break;
  }
  return problem(ErrorCode::kConflict,
                 "The drive of this session has ended; another drive is another session.",
                 standing.next_scan);
}

/// What can be said without a job: scans that are there already, that come too early, or that come
/// after the end.
UploadSource::Put judge(const Standing& standing, std::uint64_t first, std::uint64_t last) {
  if (last < *standing.next_scan) return UploadSource::Put::kHadAlready;
  if (standing.state == State::kEnded) return UploadSource::Put::kEnded;
  return first > *standing.next_scan ? UploadSource::Put::kOutOfOrder : UploadSource::Put::kTaken;
}

Response post(Services& services, const Call& call) {
  const auto& map = call.path("map");
  const auto& session = call.path("session");
  services.store.version(map);  // throws where there is no such map
  std::vector<PosedScan> scans = scans_of(call);
  const std::uint64_t first = scans.front().index;
  Standing standing = standing_of(services, map, session);
  if (standing.state == State::kStopped) refuse_stopped(standing);
  if (!standing.next_scan) refuse_path(standing);

  const bool has_job = standing.state == State::kMapping || standing.state == State::kFinishing;
  Taken taken;
  if (!has_job) taken.last = judge(standing, first, scans.back().index);
  if (has_job || taken.last == UploadSource::Put::kTaken) {
    const JobView job = has_job ? *standing.job : make_upload(services, map, session, standing);
    taken = put_scans(services, job.record.id, std::move(scans));
    standing = standing_of(services, map, session);
  }
  if (taken.scans == 0) {
    if (auto refused = refusal(taken.last, first, standing)) return *std::move(refused);
  }
  Json json = document(session, standing);
  json["taken"] = taken.scans;
  return json_response(json, 202);
}

Response complete_scans(Services& services, const Call& call) {
  const auto& map = call.path("map");
  const auto& session = call.path("session");
  services.store.version(map);  // throws where there is no such map
  Standing standing = standing_of(services, map, session);
  auto refused = scans_missing(call, standing.next_scan);
  if (refused && standing.state != State::kNew && standing.state != State::kStopped) {
    return *std::move(refused);
  }
  switch (standing.state) {
    case State::kNew:
      throw Error(ErrorCode::kNotFound, "No scan of session " + in_quotes(session) + " has come.");
    case State::kStopped:
      refuse_stopped(standing);
    case State::kMapping:
    case State::kFinishing:
      if (!standing.next_scan) refuse_path(standing);
      services.jobs.complete(standing.job->record.id);
      break;
    case State::kPaused:
      services.jobs.complete(make_upload(services, map, session, standing).record.id);
      break;
    case State::kEnded:
      break;
  }
  return json_response(document(session, standing_of(services, map, session)), 202);
}

}  // namespace

void add_session_scan_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  const std::string scans = "/v1/maps/{map}/sessions/{session}/scans";
  router.add(
      {"GET", scans, {}, 0, json, [&](const Call& call) { return get_scans(services, call); }});
  router.add({"POST", scans, {}, kMaxScanBatchBytes, json, [&](const Call& call) {
                return post(services, call);
              }});
  router.add({"POST", scans + ":complete", {"scans"}, 1024, json, [&](const Call& call) {
                return complete_scans(services, call);
              }});
}

}  // namespace cellmap::server
