#include "server/api/api.hpp"

#include <spdlog/sinks/null_sink.h>

#include <exception>

#include "cellmap/core/error.hpp"
#include "cellmap/store/staging.hpp"
#include "server/api/backup.hpp"
#include "server/api/comparison.hpp"
#include "server/api/conditions.hpp"
#include "server/api/diff.hpp"
#include "server/api/failure.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

std::shared_ptr<spdlog::logger> silent_log() {
  return std::make_shared<spdlog::logger>("cellmap",
                                          std::make_shared<spdlog::sinks::null_sink_mt>());
}

void check_query(const Route& route, const std::map<std::string, std::string>& query) {
  if (route.query.empty()) return;
  for (const auto& [name, value] : query) {
    if (std::ranges::find(route.query, name) != route.query.end()) continue;
    std::string known;
    for (const auto& other : route.query) known += (known.empty() ? "" : ", ") + other;
    throw Error(ErrorCode::kInvalidArgument,
                "Unknown query parameter " + in_quotes(name) + "; there are: " + known + ".");
  }
}

JobQueueOptions job_options(const ApiOptions& options) {
  JobQueueOptions jobs = options.jobs;
  jobs.threads = options.threads;
  return jobs;
}

}  // namespace

Services::Services(Store& store_in, std::shared_ptr<spdlog::logger> log_in, ApiOptions options_in)
    : options(std::move(options_in)),
      log(std::move(log_in)),
      store(store_in),
      maps(store, options.maps),
      jobs(maps, metrics, log, job_options(options)),
      relocalisations(options.relocalisations) {}

Api::Api(Store& store, ApiOptions options, std::shared_ptr<spdlog::logger> log)
    : services_(std::make_unique<Services>(store, log ? std::move(log) : silent_log(),
                                           std::move(options))) {
  add_viewer_routes(router_, *services_);
  add_service_routes(router_, *services_);
  add_map_routes(router_, *services_);
  add_cell_routes(router_, *services_);
  add_cell_batch_route(router_, *services_);
  add_pose_graph_routes(router_, *services_);
  add_change_routes(router_, *services_);
  add_relocalise_route(router_, *services_);
  add_loop_routes(router_, *services_);
  add_session_routes(router_, *services_);
  add_session_scan_routes(router_, *services_);
  add_diff_route(router_, *services_);
  add_split_route(router_, *services_);
  add_georeference_routes(router_, *services_);
  add_comparison_routes(router_, *services_);
  add_archive_routes(router_, *services_);
  add_backup_route(router_, *services_);
  add_job_routes(router_, *services_);
}

Api::~Api() = default;

void Api::stop() {
  services_->stopping = true;
  services_->store.committed().notify();
  services_->jobs.stop();
}

namespace {

const Route* route_of(const Router& router, std::string_view method, std::string_view target) {
  return router.find(method, target.substr(0, target.find_first_of("?#"))).route;
}

}  // namespace

std::size_t Api::max_body(std::string_view method, std::string_view target) const {
  const Route* route = route_of(router_, method, target);
  return route ? route->max_body : 0;
}

std::unique_ptr<ByteFile> Api::file_for_body(std::string_view method,
                                             std::string_view target) const {
  const Route* route = route_of(router_, method, target);
  if (!route || !route->body_in_file) return nullptr;
  return open_temporary_file(services_->options.spool_folder);
}

bool Api::may_wait(std::string_view method, std::string_view target) const {
  if (method != "GET" && method != "HEAD") return true;  // for the map's writer, or for a turn
  const Route* route = route_of(router_, method, target);
  return route && route->waits;
}

Response Api::answer(const Request& request, std::string& route_name) {
  auto target = parse_target(request.target);
  auto match = router_.find(request.method, target.path);
  if (!match.route) {
    if (!match.allow.empty()) return method_not_allowed(match.allow);
    return problem(ErrorCode::kNotFound, "There is no resource at " + in_quotes(target.path) + ".");
  }
  const Route& route = *match.route;
  route_name = route.pattern;
  if (!route.types.empty() && !negotiate(request.headers.get("Accept"), route.types)) {
    return not_acceptable(route.types.front());
  }
  const auto map = match.path.find("map");
  if (map != match.path.end() && is_staged(map->second)) {  // which is nobody's business yet
    return problem(ErrorCode::kNotFound, "There is no map " + in_quotes(map->second) + ".");
  }
  check_query(route, target.query);
  if (request.body.size() > route.max_body) {
    throw Error(ErrorCode::kTooLarge,
                "The body may have at most " + std::to_string(route.max_body) + " bytes here.");
  }
  return route.handler(Call(request, std::move(match.path), std::move(target.query)));
}

Response Api::handle(const Request& request) {
  const auto start = std::chrono::steady_clock::now();
  Response response;
  std::string route = "none";
  try {
    response = answer(request, route);
  } catch (const std::exception& error) {
    response = problem_of(std::current_exception(), request.id);
    if (response.status >= 500 && response.status != 503) {
      services_->log->error("[{}] {} {}: {}", request.id, request.method, route, error.what());
    }
  }
  if (response.status >= 400) {
    set_instance(response, std::string_view(request.target).substr(0, request.target.find('?')));
  }
  response.headers.set("X-Request-Id", request.id);
  response.headers.set("X-Content-Type-Options", "nosniff");
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  const std::string method = route == "none" ? "other" : request.method;
  services_->metrics.request(route, method, response.status, seconds, body_view(response).size());
  services_->log->debug("[{}] {} {} {} {:.1f} ms", request.id, request.method,
                        in_quotes(request.target), response.status, seconds * 1e3);
  return response;
}

}  // namespace cellmap::server
