#include "server/api/diff.hpp"

#include <algorithm>
#include <array>
#include <chrono>

#include "cellmap/change/diff.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/document/change_json.hpp"
#include "cellmap/store/all_cells.hpp"
#include "server/api/text.hpp"
#include "server/api/turn.hpp"

// GET /v1/maps/{map}/diff: what changed between two sessions.

namespace cellmap::server {
namespace {

/// The CELLs of one session that take part.
struct Side {
  std::string session;
  std::vector<PlacedCell> cells;
};

struct Question {
  std::array<std::string, 2> sessions;
  std::optional<Eigen::Vector3d> near;
  double radius_m = 0;
  bool patches = false;  ///< whether the answer names each changed patch
};

Question read_question(const Call& call) {
  Question question;
  const std::string text = call.query("sessions").value_or("");
  const auto names = split(text, ',');
  if (names.size() != 2 || names[0] == names[1]) {
    throw Error(ErrorCode::kInvalidArgument,
                "Expected 'sessions' to name two different ones, the earlier one first: "
                "sessions=monday,tuesday.");
  }
  question.sessions = {std::string(names[0]), std::string(names[1])};
  if (const auto near = call.query_numbers("near", 3)) question.near.emplace(near->data());
  const auto radius = call.query_number("radius", 0, 1e7);
  if (question.near.has_value() != radius.has_value() || (radius && *radius <= 0)) {
    throw Error(ErrorCode::kInvalidArgument,
                "'near' and 'radius' (above 0) go together: near=x,y,z&radius=100.");
  }
  question.radius_m = radius.value_or(0);
  const std::string patches = call.query("patches").value_or("false");
  if (patches != "true" && patches != "false") {
    throw Error(ErrorCode::kInvalidArgument, "Expected 'patches' to be true or false.");
  }
  question.patches = patches == "true";
  return question;
}

void require_aligned(const Store& store, const std::string& map, const std::string& name) {
  for (const SessionInfo& session : store.sessions(map)) {
    if (session.name != name) continue;
    if (session.cells > 0 && session.aligned) return;
    throw Error(ErrorCode::kConflict,
                "Session " + in_quotes(name) +
                    (session.cells == 0
                         ? " has no CELLs yet; ask again when it has been mapped."
                         : " is not in the map frame yet, so it cannot be compared. It joins when "
                           "it sees what another session saw, or when a loop between the two is "
                           "posted to /v1/maps/" +
                               map + "/loops; then ask again."));
  }
  throw Error(ErrorCode::kNotFound, "The map has no session " + in_quotes(name) + ".");
}

/// In the poses of `graph`, so that all are of one revision.
Side side_of(const Store& store, const std::string& map, const std::string& session,
             const Question& question, const PoseGraph& graph) {
  Side side{session, {}};
  for (const CellRecord& record : all_cells_of(store, map, session)) {
    const auto node = graph.nodes.find(record.id);
    if (node == graph.nodes.end()) continue;  // added since the graph was read
    const Eigen::Vector3d position = node->second.translation();
    if (question.near && (position - *question.near).norm() > question.radius_m) continue;
    side.cells.push_back({record.id, node->second});
  }
  return side;
}

void add_cells(const Side& side, const std::vector<CellDiff>& diffs, bool patches, Json& cells) {
  for (const CellDiff& diff : diffs) {
    Json cell{{"id", diff.cell.value}, {"session", side.session}};
    for (const PatchChange change : {PatchChange::kStayed, PatchChange::kVanished,
                                     PatchChange::kAppeared, PatchChange::kNeverSeen}) {
      cell[std::string(to_string(change))] = diff.count(change);
    }
    if (patches) cell["changed"] = diff.changed;
    cells.push_back(std::move(cell));
  }
}

void require_bounded(std::size_t pairs) {
  if (pairs <= kMaxDiffPairs) return;
  throw Error(ErrorCode::kTooLarge, "Comparing these sessions takes " + std::to_string(pairs) +
                                        " pairs of CELLs, and one request may take " +
                                        std::to_string(kMaxDiffPairs) +
                                        "; ask for a part of the map with near=x,y,z&radius=300.");
}

Response get_diff(Services& services, const Call& call) {
  const auto state = services.maps.open(call.path("map"));
  const Question question = read_question(call);
  for (const auto& name : question.sessions) require_aligned(services.store, state->name(), name);
  const auto graph = state->graph();
  const auto side = [&](const std::string& session) {
    return side_of(services.store, state->name(), session, question, *graph);
  };
  const Side earlier = side(question.sessions[0]), later = side(question.sessions[1]);
  DiffOptions options;
  require_bounded(pairs_to_compare(earlier.cells, later.cells, options).size());
  SessionDiff diff;
  std::chrono::duration<double, std::milli> elapsed{};
  in_turn(services, [&](const Effort& effort) {
    options.threads = effort.threads;
    options.give_way = effort.give_way;
    const auto start = std::chrono::steady_clock::now();
    diff = diff_sessions(earlier.cells, later.cells, MapState::targets(state), options);
    elapsed = std::chrono::steady_clock::now() - start;
  });

  Json regions = Json::array(), cells = Json::array();
  for (const ChangeRegion& region : diff.regions) regions.push_back(document::to_json(region));
  add_cells(earlier, diff.earlier, question.patches, cells);
  add_cells(later, diff.later, question.patches, cells);
  return json_response({{"revision", graph->revision},
                        {"sessions", question.sessions},
                        {"pairs", diff.pairs},
                        {"regions", std::move(regions)},
                        {"cells", std::move(cells)},
                        {"time_ms", elapsed.count()}});
}

}  // namespace

void add_diff_route(Router& router, Services& services) {
  router.add({"GET",
              "/v1/maps/{map}/diff",
              {"sessions", "near", "radius", "patches"},
              0,
              {"application/json"},
              [&](const Call& call) { return get_diff(services, call); },
              true});
}

}  // namespace cellmap::server
