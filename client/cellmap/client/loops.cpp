#include "cellmap/client/client_impl.hpp"

// Loop closures.

namespace cellmap {

using client::HttpRequest;
using client::Json;
using client::json_request;
using client::map_path;

LoopList Client::loops(const std::string& map) {
  return client::loop_list_from_json(impl_->get_json(map_path(map) + "/loops"));
}

ConstraintReport Client::loop(const std::string& map, ConstraintId id) {
  return client::constraint_report_from_json(
      impl_->get_json(map_path(map) + "/loops/" + std::to_string(id.value)));
}

LoopReport Client::add_loop(const std::string& map, CellId from, CellId to, const Pose& T_from_to,
                            const std::optional<Matrix6d>& information) {
  Json body = {{"from", from.value}, {"to", to.value}, {"pose", client::to_json(T_from_to)}};
  if (information) body["information"] = client::to_json(*information);
  HttpRequest request = json_request("POST", map_path(map) + "/loops", body);
  request.idempotent = false;
  return client::loop_report_from_json(impl_->send_json(request));
}

LoopReport Client::detect_loops(const std::string& map, CellId cell) {
  HttpRequest request = json_request("POST", map_path(map) + "/loops", {{"detect", cell.value}});
  request.idempotent = false;
  return client::loop_report_from_json(impl_->send_json(request));
}

LoopReport Client::pin_loop(const std::string& map, ConstraintId id, bool pinned) {
  const Json json = impl_->send_json(json_request(
      "PATCH", map_path(map) + "/loops/" + std::to_string(id.value), {{"pinned", pinned}}));
  LoopReport report = client::loop_report_from_json(json);
  report.loops = {client::constraint_from_json(json)};
  return report;
}

LoopReport Client::delete_loop(const std::string& map, ConstraintId id) {
  HttpRequest request{"DELETE", map_path(map) + "/loops/" + std::to_string(id.value), {}, ""};
  return client::loop_report_from_json(impl_->send_json(request));
}

}  // namespace cellmap
