#include "cellmap/client/client_impl.hpp"

// Sessions, merging and splitting maps, georeferences.

namespace cellmap {

using client::HttpRequest;
using client::HttpResponse;
using client::Json;
using client::json_request;
using client::kCellType;
using client::map_path;
using client::session_path;

std::vector<Session> Client::sessions(const std::string& map) {
  const Json json = impl_->get_json(map_path(map) + "/sessions");
  std::vector<Session> sessions;
  for (const Json& session : client::member(json, "sessions")) {
    sessions.push_back(client::session_from_json(session));
  }
  return sessions;
}

Session Client::session(const std::string& map, const std::string& name) {
  return client::session_from_json(impl_->get_json(session_path(map, name)));
}

Session Client::create_session(const std::string& map, const SessionInfo& session) {
  const Json body{{"name", session.name},
                  {"robot", session.robot},
                  {"sensor", session.sensor},
                  {"odometry_frame", session.odometry_frame},
                  {"started_ns", session.started}};
  return client::session_from_json(
      impl_->send_json(json_request("POST", map_path(map) + "/sessions", body)));
}

void Client::delete_session(const std::string& map, const std::string& name) {
  impl_->transport.perform({"DELETE", session_path(map, name), {}, ""});
}

Job Client::merge(const std::string& map, const std::string& from,
                  const std::set<std::string>& sessions) {
  Json body{{"from", from}};
  if (!sessions.empty()) body["sessions"] = sessions;
  HttpRequest request = json_request("POST", map_path(map) + "/merge", body);
  request.idempotent = false;
  return client::job_from_json(impl_->send_json(request));
}

MapInfo Client::split(const std::string& map, const std::set<std::string>& sessions,
                      const std::string& into) {
  HttpRequest request =
      json_request("POST", map_path(map) + "/split", {{"sessions", sessions}, {"into", into}});
  request.idempotent = false;
  return client::map_info_from_json(impl_->send_json(request));
}

void Client::set_georeference(const std::string& map,
                              const std::optional<Georeference>& georeference) {
  const std::string path = map_path(map) + "/georeference";
  if (!georeference) {
    impl_->transport.perform({"DELETE", path, {}, ""});
  } else {
    impl_->send_json(json_request("PUT", path, client::to_json(*georeference)));
  }
}

std::vector<ContentHash> Client::lacking_cells(const std::string& map, const std::string& session,
                                               std::span<const ContentHash> hashes) {
  Json list = Json::array();
  for (const ContentHash& hash : hashes) list.push_back(to_hex(hash));
  const Json answer = impl_->send_json(
      json_request("POST", session_path(map, session) + "/cells:lacking", {{"hashes", list}}));
  std::vector<ContentHash> lacking;
  for (const Json& hash : client::member(answer, "lacking")) {
    lacking.push_back(client::content_hash_from_json(hash));
  }
  return lacking;
}

SessionCell Client::put_session_cell(const std::string& map, const EncodedCell& cell) {
  const std::string session = view_cell(cell.bytes).header.session;
  HttpRequest request{"PUT", session_path(map, session) + "/cells/" + to_hex(cell.hash), {}, ""};
  impl_->set_body(request, cell.bytes, kCellType);
  const HttpResponse response = impl_->transport.perform(request);
  SessionCell result = client::session_cell_from_json(client::parse_json(response.body));
  result.created = response.status == 201;
  return result;
}

}  // namespace cellmap
