#include "server/api/api.hpp"

#include <spdlog/sinks/null_sink.h>

#include <exception>
#include <utility>

#include "cellmap/core/error.hpp"
#include "cellmap/store/staging.hpp"
#include "server/api/access.hpp"
#include "server/api/backup.hpp"
#include "server/api/comparison.hpp"
#include "server/api/conditions.hpp"
#include "server/api/diff.hpp"
#include "server/api/failure.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"
#include "server/log.hpp"

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

/// Where a store keeps no descriptions every query makes them again, so it is said now and then.
MapsOptions maps_options(const ApiOptions& options, const std::shared_ptr<spdlog::logger>& log) {
  MapsOptions maps = options.maps;
  maps.on_unkept = [log, says = std::make_shared<Seldom>()](const std::string& map,
                                                            const Error& why) {
    if (!(*says)()) return;
    log->warn("cannot keep what it described of {}, and will describe it again: {}", map,
              why.what());
  };
  return maps;
}

}  // namespace

Services::Services(Store& store_in, std::shared_ptr<spdlog::logger> log_in, ApiOptions options_in)
    : options(std::move(options_in)),
      log(std::move(log_in)),
      store(store_in),
      maps(store, maps_options(options, log)),
      jobs(maps, metrics, log, job_options(options)),
      place_servers(options.place_servers, metrics, log),
      turns{"relocalisations and comparisons", options.relocalisations,
            options.relocalisation_wait},
      // Who asks waits no longer.
      place_turns{"searches", options.place_searches, options.place_servers.timeout} {}

Api::Api(Store& store, ApiOptions options, std::shared_ptr<spdlog::logger> log)
    : services_(std::make_unique<Services>(store, log ? std::move(log) : silent_log(),
                                           std::move(options))),
      cross_origin_(services_->options.allow_origins) {
  add_viewer_routes(router_, *services_);
  add_service_routes(router_, *services_);
  add_map_routes(router_, *services_);
  add_cell_routes(router_, *services_);
  add_cell_batch_route(router_, *services_);
  add_pose_graph_routes(router_, *services_);
  add_change_routes(router_, *services_);
  add_relocalise_route(router_, *services_);
  add_place_search_route(router_, *services_);
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

void Api::reload_tokens() {
  auth::Guard* guard = services_->options.guard;
  if (!guard || !guard->asks_for_tokens()) return;
  try {
    guard->reload();
    services_->log->info("knows {} tokens now", guard->token_count());
    services_->metrics.tokens_reloaded(true);
  } catch (const Error& error) {
    services_->log->error("keeps the tokens it had: {}", error.what());
    services_->metrics.tokens_reloaded(false);
  }
}

void Api::stop() {
  services_->stopping = true;
  services_->store.committed().notify();
  services_->jobs.stop();
}

namespace {

std::string_view path_of(std::string_view target) {
  return target.substr(0, target.find_first_of("?#"));
}

const Route* route_of(const Router& router, std::string_view method, std::string_view target) {
  return router.find(method, path_of(target)).route;
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
  return router_.may_wait(method, path_of(target));
}

/// A request on its way, and what became known of it.
struct Api::Exchange {
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  Target target;
  Router::Match match;
  auth::Caller caller;

  std::string_view pattern() const {
    return match.route ? std::string_view(match.route->pattern) : "none";
  }
  std::string_view map() const {
    const std::string* name = match.path.find("map");
    return name ? std::string_view(*name) : std::string_view();
  }
};

namespace {

/// The map that a request is about, where its path says so.
std::optional<std::string> map_of(const Router::Match& match, const JobQueue& jobs) {
  if (const std::string* map = match.path.find("map")) return *map;
  const std::string* job = match.path.find("job");
  if (!job) return std::nullopt;
  const auto id = parse_unsigned(*job);
  if (!id || *id > UINT32_MAX) return std::nullopt;
  try {
    return jobs.job(JobId{static_cast<std::uint32_t>(*id)}).record.map;
  } catch (const Error& error) {
    if (error.code() == ErrorCode::kNotFound) return std::nullopt;  // as the handler will say
    throw;
  }
}

void log_request(spdlog::logger& log, const Request& request, std::string_view route,
                 const std::string& caller, const Response& response, double seconds) {
  if (!log.should_log(spdlog::level::debug)) return;
  const std::string text = fmt::format("[{}] {} {} {} {:.1f} ms", request.id, request.method,
                                       in_quotes(request.target), response.status, seconds * 1e3);
  log.debug(with_fields(text, {{"method", request.method},
                               {"route", route},
                               {"code", response.status},
                               {"duration_s", seconds},
                               {"bytes", body_view(response).size()},
                               {"caller", caller},
                               {"address", request.address}}));
}

bool says_how_it_is(const Route& route) {
  return route.pattern == "/healthz" || route.pattern == "/readyz" || route.pattern == "/metrics";
}

/// An answer without end ends when its caller's token does.
void end_with_token(Response& response, const auth::Guard& guard, const auth::Caller& caller) {
  auto* stream = std::get_if<BodyStream>(&response.body);
  if (!stream || !caller.token) return;
  response.body = [&guard, token = caller.token, next = std::move(*stream)](std::string& chunk) {
    return guard.still_knows(*token) && next(chunk);
  };
}

}  // namespace

/// Finds the route, and refuses who may not take it.
std::optional<Response> Api::admit(const Request& request, Exchange& exchange) const {
  exchange.target = parse_target(request.target);
  exchange.match = router_.find(request.method, exchange.target.path);
  const Route* route = exchange.match.route;
  const bool only_works = !services_->options.jobs.takes_scans;
  if (only_works && !(route && says_how_it_is(*route))) {
    return problem(ErrorCode::kUnavailable,
                   "This server carries out jobs and answers nothing but /healthz, /readyz and "
                   "/metrics (--role worker); ask one with --role api or all.");
  }
  auth::Guard* guard = services_->options.guard;
  if (request.caller) exchange.caller = *request.caller;
  if (!route || !guard || request.caller) return std::nullopt;
  auth::Demand demand{route->scope, {}, {}, request.address};
  if (const auto field = request.headers.get("Authorization")) demand.field = *field;
  if (route->for_servers) {
    demand.for_servers = std::max<std::size_t>(1, services_->place_servers.others());
  }
  if (guard->asks_for_tokens()) demand.map = map_of(exchange.match, services_->jobs);
  auto verdict = guard->admit(demand);
  exchange.caller = std::move(verdict.caller);
  if (verdict.refusal == auth::Refusal::kNone) return std::nullopt;
  return refused(verdict, demand);
}

Response Api::answer(const Request& request, Exchange& exchange) const {
  if (auto refusal = admit(request, exchange)) return *std::move(refusal);
  const Router::Match& match = exchange.match;
  if (!match.route) {
    if (match.allow.empty()) {
      return problem(ErrorCode::kNotFound,
                     "There is no resource at " + in_quotes(exchange.target.path) + ".");
    }
    if (auto preflight = cross_origin_.preflight(request, match.allow)) return *preflight;
    return method_not_allowed(match.allow);
  }
  const Route& route = *match.route;
  if (!route.types.empty() && !negotiate(request.headers.get("Accept"), route.types)) {
    return not_acceptable(route.types);
  }
  if (is_staged(exchange.map())) {  // which is nobody's business yet
    return problem(ErrorCode::kNotFound, "There is no map " + in_quotes(exchange.map()) + ".");
  }
  check_query(route, exchange.target.query);
  if (request.body.size() > route.max_body) {
    throw Error(ErrorCode::kTooLarge,
                "The body may have at most " + std::to_string(route.max_body) + " bytes here.");
  }
  Response response =
      route.handler(Call(request, exchange.caller, match.path, exchange.target.query));
  if (auto* guard = services_->options.guard) end_with_token(response, *guard, exchange.caller);
  return response;
}

/// The one place where errors become problem documents.
template <class Answer>
Response Api::caught(const Request& request, const Exchange& exchange, const Answer& answer) const {
  try {
    return answer();
  } catch (const std::exception& error) {
    Response response = problem_of(std::current_exception(), request.id);
    if (response.status >= 500 && response.status != 503) {
      services_->log->error("[{}] {} {}: {}", request.id, request.method, exchange.pattern(),
                            error.what());
    }
    return response;
  }
}

std::optional<Response> Api::refuse(Request& request) {
  Exchange exchange;
  bool refused = true;
  Response response = caught(request, exchange, [&] {
    auto refusal = admit(request, exchange);
    refused = refusal.has_value();
    return refused ? *std::move(refusal) : Response();
  });
  if (refused) {
    finish(request, exchange, response);
    return response;
  }
  request.caller = std::move(exchange.caller);
  return std::nullopt;
}

Response Api::handle(const Request& request) {
  Exchange exchange;
  Response response = caught(request, exchange, [&] { return answer(request, exchange); });
  finish(request, exchange, response);
  return response;
}

void Api::complete(Response& response, std::string_view target,
                   const std::string& request_id) const {
  const auto* guard = services_->options.guard;
  set_instance(response, target.substr(0, target.find('?')), request_id);
  set_standard_headers(response, request_id, guard && guard->asks_for_tokens());
}

void Api::finish(const Request& request, const Exchange& exchange, Response& response) const {
  const auto* guard = services_->options.guard;
  const Route* route = exchange.match.route;
  const bool is_private = guard && guard->asks_for_tokens() && route && route->scope;
  set_instance(response, std::string_view(request.target).substr(0, request.target.find('?')),
               request.id);
  set_standard_headers(response, request.id, is_private);
  cross_origin_.allow(request, response);
  if (route && is_write(route->scope)) audit(request, exchange, response);
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - exchange.start).count();
  services_->metrics.request(exchange.pattern(), route ? std::string_view(request.method) : "other",
                             response.status, seconds, body_view(response).size());
  log_request(*services_->log, request, exchange.pattern(), exchange.caller.name, response,
              seconds);
}

void Api::audit(const Request& request, const Exchange& exchange, const Response& response) const {
  if (!services_->options.audit) return;
  try {
    services_->options.audit->write({request.id, exchange.caller.name, request.address,
                                     request.method, std::string(exchange.target.path),
                                     std::string(exchange.map()), response.status,
                                     problem_code(response)});
  } catch (const Error& error) {
    // What was done is done; the operator has to know that its record is not whole.
    services_->log->error("[{}] {}", request.id, error.what());
    services_->metrics.audit_failed();
  }
}

}  // namespace cellmap::server
