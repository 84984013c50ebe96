#include "server/api/api.hpp"
#include "server/api/problem.hpp"

// GET /, /healthz, /readyz, /metrics and /openapi.yaml.

namespace cellmap::server {
namespace {

constexpr const char* kLandingPage = R"(<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width">
<title>CELLmap</title>
<style>body { font: 1rem/1.5 system-ui, sans-serif; max-width: 40rem; margin: 3rem auto; padding: 0 1rem }</style>
<h1>CELLmap</h1>
<p>A LiDAR map server: immutable CELLs, one pose graph a map.</p>
<ul>
<li><a href="/v1/maps">Maps</a></li>
<li><a href="/openapi.yaml">The API (OpenAPI 3.1)</a></li>
<li><a href="/metrics">Metrics</a></li>
<li><a href="/healthz">Health</a> and <a href="/readyz">readiness</a></li>
</ul>
</html>
)";

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
  router.add({"GET", "/", {}, 0, {"text/html"}, [](const Call&) {
                auto page = text_response(kLandingPage, "text/html; charset=utf-8");
                page.headers.set("Content-Security-Policy",
                                 "default-src 'none'; style-src 'unsafe-inline'");
                return page;
              }});
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
