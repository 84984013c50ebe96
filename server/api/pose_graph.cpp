#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/pipeline/refine.hpp"
#include "cellmap/scan/trajectory.hpp"
#include "server/api/api.hpp"
#include "server/api/compress.hpp"
#include "server/api/conditions.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

// /v1/maps/{map}/pose-graph and /trajectory.

namespace cellmap::server {
namespace {

constexpr const char* kGraphType = "application/vnd.cellmap.pose-graph";

Response pose_graph(Services& services, const Call& call) {
  constexpr std::array<std::string_view, 2> types{kGraphType, "application/json"};
  const auto type = negotiate(call.header("Accept"), types);
  if (!type) return not_acceptable(types);
  const auto state = services.maps.open(call.path("map"));
  const auto asked = call.query_integer("revision", 0, INT64_MAX);
  auto graph = state->graph();
  if (asked && *asked != graph->revision) {
    graph = std::make_shared<const PoseGraph>(services.store.pose_graph(state->name(), asked));
  }
  const std::string revision = std::to_string(graph->revision);
  std::vector<std::string> tags;
  for (const char* const form : {"", "-json", "-zstd", "-json-zstd"}) {
    tags.push_back("\"r" + revision + form + '"');
  }
  const bool as_json = *type == "application/json";
  Response response;
  response.headers.set("ETag", tags[as_json]);
  response.headers.set("CELLmap-Revision", revision);
  response.headers.set("Cache-Control", "no-cache");
  response.headers.set("Vary", "Accept");
  const auto condition = call.header("If-None-Match");
  if (condition && matches_etag(*condition, tags)) {
    response.status = 304;
    return response;
  }
  response.headers.set("Content-Type", *type);
  if (as_json) {
    response.body = dump(to_json(*graph));
  } else {
    auto bytes = std::make_shared<const Bytes>(encode_pose_graph(*graph));
    response.body = SharedBytes{bytes, 0, bytes->size()};
  }
  compress_if_accepted(call, response);
  if (response.headers.get("Content-Encoding")) response.headers.set("ETag", tags[as_json + 2]);
  return response;
}

/// One of the words that a parameter can be; the first is the default.
std::string choice(const Call& call, const std::string& name, const std::string& first,
                   const std::string& second) {
  const auto value = call.query(name).value_or(first);
  if (value == first || value == second) return value;
  throw Error(ErrorCode::kInvalidArgument, "Expected '" + name + "' to be " + first + " or " +
                                               second + ", found " + in_quotes(value) + ".");
}

Trajectory odometry_trajectory(const std::vector<CellScans>& stretches) {
  std::vector<StampedPose> poses;
  for (const auto& stretch : stretches) {
    for (const auto& scan : stretch.scans) {
      poses.push_back({scan.stamp, stretch.T_odom_cell * scan.T_cell_scan});
    }
  }
  return Trajectory(std::move(poses));
}

Response trajectory(Services& services, const Call& call) {
  const auto session = call.query("session");
  if (!session) throw Error(ErrorCode::kInvalidArgument, "Expected 'session' in the query.");
  const std::string format = choice(call, "format", "tum", "kitti");
  const std::string stage = choice(call, "stage", "corrected", "odometry");
  const auto state = services.maps.open(call.path("map"));
  const auto stretches = services.store.scans(state->name(), *session);
  if (stretches.empty()) {
    throw Error(ErrorCode::kNotFound, "The map has no session " + in_quotes(*session) + ".");
  }
  const Trajectory result = stage == "odometry"
                                ? odometry_trajectory(stretches)
                                : corrected_trajectory(stretches, state->graph()->nodes);
  Response response;
  response.headers.set("Content-Type", "text/plain; charset=utf-8");
  response.body =
      to_text(result, format == "kitti" ? TrajectoryFormat::kKitti : TrajectoryFormat::kTum);
  return response;
}

}  // namespace

void add_pose_graph_routes(Router& router, Services& services) {
  router.add({"GET", "/v1/maps/{map}/pose-graph", {"revision"}, 0, {}, [&](const Call& call) {
                return pose_graph(services, call);
              }});
  router.add({"GET",
              "/v1/maps/{map}/trajectory",
              {"session", "format", "stage"},
              0,
              {"text/plain"},
              [&](const Call& call) { return trajectory(services, call); }});
}

}  // namespace cellmap::server
