#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "cellmap/cell/cell.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/map/junction.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/pose_graph/edit.hpp"
#include "cellmap/pose_graph/frames.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "server/api/api.hpp"
#include "server/jobs/redo.hpp"

// /v1/maps/{map}/loops and /v1/maps/{map}/loops/{loop}.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxLoopBody = 64u << 10;

/// What a posted loop is believed to without an information matrix.
constexpr double kDefaultSigma_m = 0.1;
constexpr double kDefaultSigma_rad = 0.5 * std::numbers::pi / 180;

Matrix6d default_information() {
  Tangent diagonal;
  diagonal.head<3>().setConstant(1 / (kDefaultSigma_m * kDefaultSigma_m));
  diagonal.tail<3>().setConstant(1 / (kDefaultSigma_rad * kDefaultSigma_rad));
  return diagonal.asDiagonal();
}

struct LoopRequest {
  std::optional<CellId> detect;
  Constraint measured;  ///< where `detect` is not set
};

LoopRequest read_loop_request(const Json& json) {
  ObjectReader reader(json, "the loop");
  const auto detect = reader.integer("detect", UINT32_MAX);
  const auto from = reader.integer("from", UINT32_MAX), to = reader.integer("to", UINT32_MAX);
  const auto pose = reader.pose("pose");
  const auto information = reader.matrix("information");
  reader.finish();
  LoopRequest request;
  if (detect && !from && !to && !pose && !information) {
    request.detect = CellId{static_cast<std::uint32_t>(*detect)};
    return request;
  }
  if (detect || !from || !to || !pose) {
    throw Error(ErrorCode::kInvalidArgument,
                "Expected either 'from', 'to' and 'pose' (T_from_to), or 'detect' with a CELL.");
  }
  request.measured.from = CellId{static_cast<std::uint32_t>(*from)};
  request.measured.to = CellId{static_cast<std::uint32_t>(*to)};
  request.measured.T_from_to = *pose;
  request.measured.information = information.value_or(default_information());
  request.measured.kind = ConstraintKind::kLoop;
  request.measured.origin = ConstraintOrigin::kUser;
  validate(request.measured);
  return request;
}

void check_node(const PoseGraph& graph, CellId id) {
  if (graph.nodes.contains(id)) return;
  throw Error(ErrorCode::kNotFound, "The map has no CELL " + std::to_string(id.value) + ".");
}

bool has_loop(const PoseGraph& graph, CellId a, CellId b) {
  return std::ranges::any_of(graph.constraints, [&](const Constraint& c) {
    return c.kind == ConstraintKind::kLoop &&
           ((c.from == a && c.to == b) || (c.from == b && c.to == a));
  });
}

/// The CELL seen as a scan is its reconstructed points: base scans are not kept.
std::vector<Constraint> detect(const Services& services,
                               const std::shared_ptr<const MapState>& state, const PoseGraph& graph,
                               CellId id) {
  const auto target = state->target(id);
  const PointCloud points = reconstruct_points(target->cell(), *state->lattice());
  LoopOptions options;
  options.closures = options.candidates;  // who asks wants all
  options.registration.threads = services.options.threads;
  std::vector<Constraint> found;
  for (const auto& closure : detect_loops(graph, id, points, MapState::targets(state), options)) {
    if (has_loop(graph, closure.from, closure.to)) continue;
    found.push_back(to_constraint(closure, ConstraintOrigin::kDetection));
  }
  return found;
}

/// A loop that somebody measured between two islands says where they lie to one another.
void bring_together(PoseGraph& graph, const Constraint& loop) {
  const Frames islands(graph);
  Junction junction;
  junction.other = islands.of(loop.from);
  junction.island = islands.of(loop.to);
  if (junction.other == junction.island) return;
  junction.T_other_island =
      graph.nodes.at(loop.from) * loop.T_from_to * graph.nodes.at(loop.to).inverse();
  bring_together(graph, junction);
}

struct Optimised {
  MapUpdate update;  ///< the poses that moved, constraints as they are judged now, new ones
  PoseGraphSummary summary;
};

/// Optimises a changed graph against the stored one. New constraints follow the others.
Optimised optimised(const Services& services, const PoseGraph& before, PoseGraph after) {
  PoseGraphOptions options;
  options.threads = services.options.threads;
  Optimised result;
  result.summary = optimize(after, options);
  std::ranges::set_difference(before.unaligned, after.unaligned,
                              std::inserter(result.update.aligned, result.update.aligned.end()));
  for (const auto& [id, pose] : after.nodes) {
    if (!(pose.matrix() == before.nodes.at(id).matrix())) result.update.poses.emplace(id, pose);
  }
  result.update.judged = judged_anew(before.constraints, after.constraints);
  std::ranges::copy_if(after.constraints, std::back_inserter(result.update.add_constraints),
                       [](const Constraint& c) { return c.id.value == 0; });
  result.update.expected_revision = before.revision;
  return result;
}

Json answer(Revision revision, const std::vector<Constraint>& loops,
            const PoseGraphSummary& summary) {
  Json list = Json::array();
  for (const auto& loop : loops) list.push_back(to_json(loop));
  return {{"revision", revision},
          {"loops", std::move(list)},
          {"moved", summary.moved},
          {"initial_cost", summary.initial_cost},
          {"final_cost", summary.final_cost}};
}

Response add(Services& services, const LoopRequest& request,
             const std::shared_ptr<const MapState>& state) {
  const std::lock_guard lock(state->writer());
  const auto graph = state->graph();
  std::vector<Constraint> loops;
  if (request.detect) {
    check_node(*graph, *request.detect);
    loops = detect(services, state, *graph, *request.detect);
    if (loops.empty()) return json_response(answer(graph->revision, {}, {}));
  } else {
    check_node(*graph, request.measured.from);
    check_node(*graph, request.measured.to);
    loops.push_back(request.measured);
  }
  PoseGraph changed = *graph;
  for (const Constraint& loop : loops) bring_together(changed, loop);
  changed.constraints.insert(changed.constraints.end(), loops.begin(), loops.end());
  const Optimised result = optimised(services, *graph, std::move(changed));
  loops = result.update.add_constraints;
  const auto committed = services.store.commit(state->name(), result.update);
  for (std::size_t i = 0; i < loops.size(); ++i) loops[i].id = committed.constraint_ids[i];
  Response response = json_response(answer(committed.revision, loops, result.summary), 201);
  response.headers.set(
      "Location", "/v1/maps/" + state->name() + "/loops/" + std::to_string(loops.front().id.value));
  return response;
}

std::vector<Constraint> loops_of(const PoseGraph& graph) {
  std::vector<Constraint> loops;
  std::ranges::copy_if(graph.constraints, std::back_inserter(loops),
                       [](const auto& c) { return c.kind == ConstraintKind::kLoop; });
  return loops;
}

void check_loop(const PoseGraph& graph, ConstraintId id) {
  for (const auto& loop : loops_of(graph)) {
    if (loop.id == id) return;
  }
  throw Error(ErrorCode::kNotFound, "The map has no loop " + std::to_string(id.value) + ".");
}

/// A loop, what became of it and how it stands at the poses of now.
Json explanation(const PoseGraph& graph, ConstraintId id) {
  check_loop(graph, id);
  Json json = to_json(explain(graph, id));
  json["revision"] = graph.revision;
  return json;
}

Response list_loops(Services& services, const Call& call) {
  const auto graph = services.maps.open(call.path("map"))->graph();
  Json loops = Json::array();
  for (const auto& loop : loops_of(*graph)) loops.push_back(to_json(loop));
  return json_response({{"revision", graph->revision}, {"loops", std::move(loops)}});
}

Response get_loop(Services& services, const Call& call) {
  const ConstraintId id{call.path_id("loop")};
  return json_response(explanation(*services.maps.open(call.path("map"))->graph(), id));
}

bool read_pin(const Json& json) {
  ObjectReader reader(json, "the change");
  const auto pinned = reader.boolean("pinned");
  reader.finish();
  if (!pinned) throw Error(ErrorCode::kInvalidArgument, "Expected 'pinned', true or false.");
  return *pinned;
}

Response pin(Services& services, ConstraintId id, bool pinned,
             const std::shared_ptr<const MapState>& state) {
  const std::lock_guard lock(state->writer());
  const auto graph = state->graph();
  check_loop(*graph, id);
  PoseGraph changed = *graph;
  set_pinned(changed, id, pinned);
  const Optimised result = optimised(services, *graph, std::move(changed));
  services.store.commit(state->name(), result.update);
  Json json = explanation(*state->graph(), id);
  json["moved"] = result.summary.moved;
  return json_response(json);
}

Response remove_loop(Services& services, ConstraintId id,
                     const std::shared_ptr<const MapState>& state) {
  const std::lock_guard lock(state->writer());
  const auto graph = state->graph();
  check_loop(*graph, id);
  PoseGraph changed = *graph;
  erase_constraint(changed, id);
  Optimised result = optimised(services, *graph, std::move(changed));
  result.update.remove_constraints = {id};
  const auto committed = services.store.commit(state->name(), result.update);
  return json_response({{"revision", committed.revision}, {"moved", result.summary.moved}});
}

}  // namespace

void add_loop_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  const std::string all = "/v1/maps/{map}/loops", one = "/v1/maps/{map}/loops/{loop}";
  router.add(
      {"GET", all, {}, 0, json, [&](const Call& call) { return list_loops(services, call); }});
  router.add({"POST", all, {}, kMaxLoopBody, json, [&](const Call& call) {
                const auto state = services.maps.open(call.path("map"));
                const LoopRequest request = read_loop_request(call.json());
                return redo_a_few_times([&] { return add(services, request, state); });
              }});
  router.add({"GET", one, {}, 0, json, [&](const Call& call) { return get_loop(services, call); }});
  router.add({"PATCH", one, {}, kMaxLoopBody, json, [&](const Call& call) {
                const auto state = services.maps.open(call.path("map"));
                const bool pinned = read_pin(call.json());
                const ConstraintId id{call.path_id("loop")};
                return redo_a_few_times([&] { return pin(services, id, pinned, state); });
              }});
  router.add({"DELETE", one, {}, 0, json, [&](const Call& call) {
                const auto state = services.maps.open(call.path("map"));
                const ConstraintId id{call.path_id("loop")};
                return redo_a_few_times([&] { return remove_loop(services, id, state); });
              }});
}

}  // namespace cellmap::server
