#include "server/api/api.hpp"
#include "server/api/problem.hpp"

// GET /healthz, /readyz, /metrics and /openapi.yaml.

namespace cellmap::server {
namespace {

Response text_response(std::string text, const char* type) {
  Response response;
  response.headers.set("Content-Type", type);
  response.body = std::move(text);
  return response;
}

Response ready(Services& services) {
  if (services.jobs.is_stopping()) {
    return problem(ErrorCode::kUnavailable, "The server is stopping.");
  }
  try {
    services.store.check_ready();
  } catch (const Error& error) {
    services.log->warn("not ready: {}", error.what());
    return problem(ErrorCode::kUnavailable, "The store cannot be read and written.");
  }
  return json_response({{"status", "ready"}});
}

}  // namespace

void add_service_routes(Router& router, Services& services) {
  router.add({"GET", "/healthz", {}, 0, {}, [](const Call&) {
                return json_response({{"status", "ok"}});
              }});
  router.add({"GET", "/readyz", {}, 0, {}, [&services](const Call&) { return ready(services); }});
  router.add({"GET", "/metrics", {}, 0, {}, [&services](const Call&) {
                return text_response(services.metrics.text(), "text/plain; version=0.0.4");
              }});
  router.add({"GET", "/openapi.yaml", {}, 0, {}, [&services](const Call&) {
                return text_response(services.options.openapi, "application/yaml");
              }});
}

}  // namespace cellmap::server
