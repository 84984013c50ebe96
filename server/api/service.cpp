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

/// The store's files, one of which may not be there.
std::uint64_t store_bytes(const std::filesystem::path& file) {
  std::uint64_t bytes = 0;
  if (file.empty()) return bytes;
  for (const char* suffix : {"", "-wal", "-shm"}) {
    std::error_code error;
    const auto size = std::filesystem::file_size(file.string() + suffix, error);
    if (!error) bytes += size;
  }
  return bytes;
}

/// Nothing while the store is away: that is when somebody looks at the other figures.
std::optional<StoreCounts> store_counts(const Services& services) try {
  StoreCounts counts;
  for (const MapInfo& map : services.store.maps()) {
    ++counts.maps;
    counts.cells += map.cells;
    counts.scans += map.scans;
    counts.cell_bytes += map.stored_bytes;
  }
  const auto jobs = services.jobs.unfinished();
  counts.queued_jobs = jobs.queued;
  counts.running_jobs = jobs.running;
  return counts;
} catch (const Error& error) {
  services.log->warn("metrics without those of the store: {}", error.what());
  return std::nullopt;
}

MetricsSnapshot snapshot(const Services& services) {
  MetricsSnapshot snapshot;
  snapshot.store = store_counts(services);
  snapshot.store_bytes = store_bytes(services.options.store_file);
  snapshot.place_bytes = services.maps.place_bytes();
  if (services.options.guard) snapshot.tokens = services.options.guard->token_count();
  return snapshot;
}

}  // namespace

void add_service_routes(Router& router, Services& services) {
  router.add({"GET", "/healthz", {}, 0, {}, [](const Call&) {
                return json_response({{"status", "ok"}});
              }});
  router.add({"GET", "/readyz", {}, 0, {}, [&services](const Call&) { return ready(services); }});
  router.add({"GET", "/metrics", {}, 0, {}, [&services](const Call&) {
                return text_response(services.metrics.text(snapshot(services)),
                                     "text/plain; version=0.0.4");
              }});
  router.add({"GET", "/openapi.yaml", {}, 0, {}, [&services](const Call&) {
                return text_response(services.options.openapi, "application/yaml");
              }});
}

}  // namespace cellmap::server
