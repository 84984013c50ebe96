#include "server/jobs/merge.hpp"

#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/pose_graph/frames.hpp"
#include "cellmap/store/copy_sessions.hpp"

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxSessions = 1000;

/// Ties a copied CELL to what it sees of the rest. True where its island has joined the map frame.
bool revisit(Store& store, const MapState& state, const BackEnd& back_end, CellId id) {
  const std::lock_guard lock(state.writer());
  PoseGraph graph = *state.graph();
  CellUpdate update = back_end.revisit(id, finished_without_scans(state.target(id)), graph);
  const bool aligned = !graph.unaligned.contains(id);
  if (!update.constraints.empty()) store.commit(state.name(), to_map_update(std::move(update)));
  return aligned;
}

}  // namespace

MergeRequest parse_merge_request(const Json& json) {
  MergeRequest request;
  ObjectReader reader(json, "the merge");
  const auto from = reader.text("from");
  if (!from) throw Error(ErrorCode::kInvalidArgument, "Expected 'from', the name of a map.");
  request.from = *from;
  validate_map_name(request.from);
  if (const Json* sessions = reader.array("sessions", kMaxSessions)) {
    request.sessions = session_names(*sessions);
  }
  reader.finish();
  return request;
}

void run_merge(Maps& maps, const std::string& map, const MergeRequest& request,
               const std::stop_token& stop, const IngestHooks& hooks) {
  Store& store = maps.store();
  std::set<std::string> sessions = request.sessions;
  if (sessions.empty()) {
    for (const SessionInfo& session : store.sessions(request.from)) sessions.insert(session.name);
  }
  const auto state = maps.open(map);
  std::map<CellId, CellId> copied;
  {
    const std::lock_guard lock(state->writer());
    copied = copy_sessions(store, request.from, sessions, map, stop, hooks.committed);
  }
  const BackEnd back_end(request.options, MapState::access(state));
  std::vector<CellId> early;  // seen before their island joined
  for (const auto& [old, id] : copied) {
    throw_if_stopped(stop);
    if (!revisit(store, *state, back_end, id)) early.push_back(id);
  }
  for (const CellId id : early) {
    throw_if_stopped(stop);
    if (!state->graph()->unaligned.contains(id)) revisit(store, *state, back_end, id);
  }
}

}  // namespace cellmap::server
