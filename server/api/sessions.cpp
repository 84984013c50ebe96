#include <set>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/codec/scan_codec.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/all_cells.hpp"
#include "server/api/api.hpp"
#include "server/api/media_types.hpp"
#include "server/api/text.hpp"
#include "server/jobs/ingest.hpp"
#include "server/jobs/redo.hpp"

// /v1/maps/{map}/sessions and what belongs to one session: its CELLs by content hash.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxSessionBody = 64u << 10;
constexpr std::size_t kMaxHashes = 10'000;
constexpr std::size_t kMaxHashesBody = 1u << 20;

/// The last CELL tells where the odometry frame lies.
Json document(Services& services, const std::string& map, const SessionInfo& session) {
  Json started, last_cell, T_map_odom;
  if (session.started > 0) started = to_rfc3339(session.started);
  if (const auto last = services.store.last_cell(map, session.name)) {
    last_cell = last->id.value;
    if (session.aligned) {
      const Pose T_odom_cell = load_cell(services.store, map, last->id).T_odom_cell;
      T_map_odom = to_json(Pose(last->T_map_cell * T_odom_cell.inverse()));
    }
  }
  return {{"name", session.name},
          {"robot", session.robot},
          {"sensor", session.sensor},
          {"odometry_frame", session.odometry_frame},
          {"started", std::move(started)},
          {"cells", session.cells},
          {"planes", session.planes},
          {"encoded_bytes", session.encoded_bytes},
          {"aligned", session.cells > 0 && session.aligned},
          {"last_cell", std::move(last_cell)},
          {"T_map_odom", std::move(T_map_odom)}};
}

SessionInfo find_session(const Store& store, const std::string& map, const std::string& name) {
  for (SessionInfo& session : store.sessions(map)) {
    if (session.name == name) return session;
  }
  throw Error(ErrorCode::kNotFound, "The map has no session " + in_quotes(name) + ".");
}

Response list_sessions(Services& services, const Call& call) {
  const auto& map = call.path("map");
  Json sessions = Json::array();
  for (const auto& session : services.store.sessions(map)) {
    sessions.push_back(document(services, map, session));
  }
  return json_response({{"sessions", std::move(sessions)}});
}

Response get_session(Services& services, const Call& call) {
  const auto& map = call.path("map");
  return json_response(
      document(services, map, find_session(services.store, map, call.path("session"))));
}

Response create_session(Services& services, const Call& call) {
  const auto& map = call.path("map");
  const Json json = call.json();
  ObjectReader reader(json, "the session");
  SessionInfo session;
  const auto name = reader.text("name");
  if (!name) throw Error(ErrorCode::kInvalidArgument, "Expected a 'name' for the session.");
  session.name = *name;
  session.robot = reader.text("robot").value_or("");
  session.sensor = reader.text("sensor").value_or("");
  session.odometry_frame = reader.text("odometry_frame").value_or("");
  session.started = static_cast<Stamp>(reader.integer("started_ns", INT64_MAX).value_or(0));
  reader.finish();
  const SessionInfo made = services.store.create_session(map, session);
  Response response = json_response(document(services, map, made), 201);
  response.headers.set("Location", "/v1/maps/" + map + "/sessions/" + made.name);
  return response;
}

/// Writers hold on to CELLs of the map, so none may be at work.
Response remove_session(Services& services, const Call& call) {
  const auto state = services.maps.open(call.path("map"));
  const std::lock_guard lock(state->writer());
  if (services.jobs.has_unfinished(state->name())) {
    throw Error(ErrorCode::kConflict, "The map has unfinished jobs; cancel them first.");
  }
  MapUpdate update;
  update.remove_sessions = {find_session(services.store, state->name(), call.path("session")).name};
  services.store.commit(state->name(), update);
  Response response;
  response.status = 204;
  return response;
}

Response lacking(Services& services, const Call& call) {
  const Json json = call.json();
  ObjectReader reader(json, "the question");
  const Json* asked = reader.array("hashes", kMaxHashes);
  reader.finish();
  if (!asked) throw Error(ErrorCode::kInvalidArgument, "Expected 'hashes', an array of text.");
  std::set<std::string> there;
  for (const auto& cell : services.store.keeping(call.path("map"), call.path("session"))) {
    there.insert(to_hex(cell.hash));
    there.insert(to_hex(cell.source));
  }
  Json answer = Json::array();
  for (const Json& hash : *asked) {
    if (!hash.is_string()) {
      throw Error(ErrorCode::kInvalidArgument, "Expected 'hashes' to hold text only.");
    }
    if (!there.contains(hash.get<std::string>())) answer.push_back(hash);
  }
  return json_response({{"lacking", std::move(answer)}});
}

void check_cell(const Call& call, const MapState& state, const CellView& view) {
  if (to_hex(view.hash) != call.path("hash")) {
    throw Error(ErrorCode::kInvalidArgument,
                "The CELL's hash is " + to_hex(view.hash) + ", not that of the path.");
  }
  if (view.header.session != call.path("session")) {
    throw Error(ErrorCode::kInvalidArgument, "The CELL belongs to session " +
                                                 in_quotes(view.header.session) +
                                                 ", not to that of the path.");
  }
  if (view.header.lattice != state.lattice()->spec()) {
    throw Error(ErrorCode::kInvalidArgument, "The CELL's lattice is " +
                                                 to_string(view.header.lattice) + ", the map's " +
                                                 to_string(state.lattice()->spec()) + ".");
  }
}

Response cell_answer(Services& services, const Call& call, const CellRecord& record, int status) {
  const auto& map = call.path("map");
  Json json = to_json(record);
  json["revision"] = services.store.map(map).revision;
  json["aligned"] = find_session(services.store, map, record.session).aligned;
  Response response = json_response(json, status);
  if (status == 201) {
    response.headers.set("Location",
                         "/v1/maps/" + map + "/cells/" + std::to_string(record.id.value));
  }
  return response;
}

Response put_next_cell(Services& services, const Call& call,
                       const std::shared_ptr<const MapState>& state, const Bytes& bytes,
                       const CellView& view) {
  const auto& map = call.path("map");
  const std::lock_guard lock(state->writer());
  const auto last = services.store.last_cell(map, view.header.session);
  const std::uint32_t expected = last ? last->sequence + 1 : 0;
  if (view.header.sequence < expected) {
    for (const CellKeeping& there : services.store.keeping(map, view.header.session)) {
      if (there.hash != view.hash && there.source != view.hash) continue;
      return cell_answer(services, call, services.store.cell(map, there.id), 200);
    }
    throw Error(ErrorCode::kConflict, "The session has another CELL with sequence " +
                                          std::to_string(view.header.sequence) +
                                          "; CELLs never change.");
  }
  if (view.header.sequence > expected) {
    throw Error(ErrorCode::kConflict, "CELLs come in order: expected sequence " +
                                          std::to_string(expected) + ", found " +
                                          std::to_string(view.header.sequence) + ".");
  }
  MapperOptions options;
  options.registration.threads = options.loops.registration.threads =
      options.junction.relocalise.threads = services.options.threads;
  BackEnd back_end(options, MapState::access(state));
  if (last) {
    back_end.resume_after(last->id, finished_without_scans(state->target(last->id)));
  }
  KeptCell kept = keep_cell(std::make_shared<const Cell>(view.to_cell()),
                            services.store.map(map).form, EncodedCell{view.hash, bytes});
  FinishedCell finished = finished_without_scans(
      std::make_shared<const RegistrationTarget>(kept.cell, state->lattice()));
  extend(services.store, *state, back_end, finished, kept);
  services.metrics.cells_committed(1);
  return cell_answer(services, call, *services.store.last_cell(map, view.header.session), 201);
}

Response put_session_cell(Services& services, const Call& call) {
  const auto state = services.maps.open(call.path("map"));
  call.content_type({kCellType});
  const std::string body = call.content(kMaxCellBytes);
  const Bytes bytes(as_bytes(body).begin(), as_bytes(body).end());
  const CellView view = view_cell(bytes);
  check_cell(call, *state, view);
  return redo_a_few_times([&] { return put_next_cell(services, call, state, bytes, view); });
}

}  // namespace

void add_session_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  const std::string all = "/v1/maps/{map}/sessions", one = all + "/{session}";
  router.add(
      {"GET", all, {}, 0, json, [&](const Call& call) { return list_sessions(services, call); }});
  router.add({"POST", all, {}, kMaxSessionBody, json, [&](const Call& call) {
                return create_session(services, call);
              }});
  router.add(
      {"GET", one, {}, 0, json, [&](const Call& call) { return get_session(services, call); }});
  router.add(
      {"DELETE", one, {}, 0, {}, [&](const Call& call) { return remove_session(services, call); }});
  router.add({"POST", one + "/cells:lacking", {}, kMaxHashesBody, json, [&](const Call& call) {
                return lacking(services, call);
              }});
  router.add({"PUT", one + "/cells/{hash}", {}, kMaxCellBytes, json, [&](const Call& call) {
                return put_session_cell(services, call);
              }});
}

}  // namespace cellmap::server
