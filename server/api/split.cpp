#include "cellmap/core/error.hpp"
#include "cellmap/store/copy_sessions.hpp"
#include "cellmap/store/staging.hpp"
#include "server/api/access.hpp"
#include "server/api/api.hpp"

// POST /v1/maps/{map}/split.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxSplitBody = 64u << 10;
constexpr std::size_t kMaxSessions = 1000;

struct SplitRequest {
  std::set<std::string> sessions;
  std::string into;
};

SplitRequest read_split_request(const Json& json) {
  SplitRequest request;
  ObjectReader reader(json, "the split");
  const Json* sessions = reader.array("sessions", kMaxSessions);
  const auto into = reader.text("into");
  reader.finish();
  if (!sessions || !into) {
    throw Error(ErrorCode::kInvalidArgument,
                "Expected 'sessions', an array of names, and 'into', the name of a new map.");
  }
  request.sessions = session_names(*sessions);
  request.into = *into;
  return request;
}

/// The sessions leave in the transaction that shows them in the other map.
Response split(Services& services, const Call& call) {
  const auto state = services.maps.open(call.path("map"));
  const SplitRequest request = read_split_request(call.json());
  if (!call.may_use(request.into)) return map_refused(request.into);
  Store& store = services.store;
  const std::lock_guard lock(state->writer());
  if (services.jobs.has_unfinished(state->name())) {
    throw Error(ErrorCode::kConflict, "The map has unfinished jobs; cancel them first.");
  }
  StagedMap staged(store, state->lattice()->spec(), request.into);
  store.set_form(staged.name(), store.map(state->name()).form);
  copy_sessions(store, state->name(), request.sessions, staged.name());
  store.set_georeference(staged.name(), store.map(state->name()).georeference);
  Staging::Along along{state->name(), {}};
  along.update.remove_sessions = request.sessions;
  Response response = json_response(to_json(staged.publish(along)), 201);
  response.headers.set("Location", "/v1/maps/" + request.into);
  return response;
}

}  // namespace

void add_split_route(Router& router, Services& services) {
  router.add({"POST",
              "/v1/maps/{map}/split",
              {},
              kMaxSplitBody,
              {"application/json"},
              [&](const Call& call) { return split(services, call); }});
}

}  // namespace cellmap::server
