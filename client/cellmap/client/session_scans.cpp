#include <array>

#include "cellmap/client/client_impl.hpp"
#include "cellmap/codec/scan_batch.hpp"

namespace cellmap {
namespace {

using client::HttpRequest;
using client::HttpResponse;
using client::Json;

constexpr char kScansType[] = "application/vnd.cellmap.scans";

SessionScans::State state_from(const std::string& name) {
  using State = SessionScans::State;
  constexpr std::array<std::pair<const char*, State>, 6> kNames{{{"new", State::kNew},
                                                                 {"mapping", State::kMapping},
                                                                 {"finishing", State::kFinishing},
                                                                 {"paused", State::kPaused},
                                                                 {"stopped", State::kStopped},
                                                                 {"ended", State::kEnded}}};
  for (const auto& [known, state] : kNames) {
    if (name == known) return state;
  }
  throw Error(ErrorCode::kCorruptData,
              "the server names an unknown state of a session's scans: '" + name + "'");
}

SessionScans from_json(const Json& json) {
  SessionScans scans;
  scans.state = state_from(client::text_member(json, "state"));
  if (!client::member(json, "next_scan").is_null()) {
    scans.next_scan = client::unsigned_member(json, "next_scan");
  }
  scans.keep_from = client::unsigned_member(json, "keep_from");
  scans.room = client::unsigned_member(json, "room");
  if (json.contains("taken")) scans.taken = client::unsigned_member(json, "taken");
  const Json& job = client::member(json, "job");
  if (!job.is_null()) scans.job = client::job_from_json(job);
  return scans;
}

std::string scans_path(const std::string& map, const std::string& session) {
  return client::session_path(map, session) + "/scans";
}

}  // namespace

SessionScans Client::session_scans(const std::string& map, const std::string& session) {
  return from_json(impl_->get_json(scans_path(map, session)));
}

SessionScans Client::post_session_scans(const std::string& map, const std::string& session,
                                        std::span<const PosedScan> scans) {
  HttpRequest request{"POST", scans_path(map, session), {{"accept", "application/json"}}, ""};
  Bytes batch;
  for (const PosedScan& scan : scans) append_to_scan_batch(batch, scan);
  impl_->set_body(request, batch, kScansType);
  const HttpResponse response = impl_->transport.perform(request, true);
  if (response.status != 409) return from_json(client::parse_json(response.body));
  const Json problem = client::parse_json(response.body);
  if (problem.is_object() && problem.contains("next_scan")) return session_scans(map, session);
  throw client::problem_to_error(409, response.header("content-type"), response.body,
                                 "POST " + request.path);
}

SessionScans Client::complete_session(const std::string& map, const std::string& session) {
  return from_json(impl_->send_json(
      {"POST", scans_path(map, session) + ":complete", {{"accept", "application/json"}}, ""}));
}

}  // namespace cellmap
