#include <spdlog/spdlog.h>

#include <cmath>
#include <csignal>
#include <filesystem>
#include <iostream>
#include <thread>

#include "cellmap/core/error.hpp"
#include "cellmap/store/open_store.hpp"
#include "cellmap/store/store_place.hpp"
#include "server/api/api.hpp"
#include "server/http/client_address.hpp"
#include "server/http_server.hpp"
#include "server/log.hpp"
#include "server/openapi_text.hpp"
#include "server/settings.hpp"

// cellmapd: serves the maps of one store over HTTP.

namespace {

namespace fs = std::filesystem;
using cellmap::Error;
using cellmap::ErrorCode;
using cellmap::server::Settings;

std::vector<fs::path> canonical_roots(const Settings& settings) {
  std::vector<fs::path> roots;
  for (const auto& root : settings.data_roots) {
    std::error_code error;
    roots.push_back(fs::canonical(root, error));
    if (error || !fs::is_directory(roots.back())) {
      throw Error(ErrorCode::kNotFound, "The data root " + root + " is no folder.");
    }
  }
  return roots;
}

/// The folder that was asked for, else where the viewer lies beside this program: as installed
/// (PREFIX/bin) or in the build tree. Empty where it lies nowhere.
fs::path viewer_folder(const Settings& settings) {
  if (!settings.viewer.empty()) return settings.viewer;
  std::error_code error;
  const fs::path here = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* place : {"../share/cellmap/web", "../web/dist"}) {
    if (!error && fs::is_regular_file(here / place / "index.html")) return here / place;
  }
  return {};
}

void on_hangup(cellmap::server::Api& api, cellmap::server::AuditLog* audit, spdlog::logger& log) {
  api.reload_tokens();
  try {
    if (audit) audit->reopen();
  } catch (const Error& error) {
    log.error("goes on with the old audit log: {}", error.what());
  }
}

/// Stops the server at the first SIGTERM or SIGINT; at SIGHUP reads its files again. The signals
/// are blocked in every thread, so that they wait here.
std::thread heed_signals(sigset_t signals, cellmap::server::Api& api,
                         cellmap::server::HttpServer& server, cellmap::server::AuditLog* audit,
                         spdlog::logger& log) {
  return std::thread([signals, &api, &server, audit, &log] {
    for (int signal = 0; sigwait(&signals, &signal) == 0 && signal == SIGHUP;) {
      on_hangup(api, audit, log);
    }
    log.info("stops: jobs that run are handed back");
    server.stop();
    api.stop();
  });
}

cellmap::server::ApiOptions api_options(const Settings& settings) {
  cellmap::server::ApiOptions options;
  options.openapi = cellmap::server::openapi_text();
  options.viewer = viewer_folder(settings);
  options.threads = settings.threads;
  options.maps.place_bytes = settings.place_memory_mib << 20;
  options.place_servers = cellmap::server::place_servers_of(settings);
  options.jobs.carries_out = settings.role != "api";
  options.jobs.takes_scans = settings.role != "worker";
  options.jobs.shares_drives = !cellmap::store_file(settings.store);  // a file has one process
  options.jobs.lease = std::chrono::milliseconds(std::lround(settings.job_lease_s * 1000));
  options.jobs.data_roots = canonical_roots(settings);
  if (const auto file = cellmap::store_file(settings.store)) {
    options.store_file = *file;
    options.spool_folder = fs::absolute(*file).parent_path();
  }
  options.allow_origins = settings.allow_origins;
  return options;
}

cellmap::server::HttpServerOptions http_options(const Settings& settings) {
  cellmap::server::HttpServerOptions options;
  options.listen = settings.listen;
  for (const std::string& proxy : settings.trusted_proxies) {
    options.trusted_proxies.push_back(cellmap::server::address_name(proxy).value_or(proxy));
  }
  options.front.max_connections = static_cast<std::size_t>(settings.max_connections);
  options.front.waits_for_database = !cellmap::store_file(settings.store);
  return options;
}

void serve(const Settings& settings) {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  using cellmap::server::LogFormat;
  const bool json = settings.log_format == "json";
  const auto log = make_log(settings.log_level, json ? LogFormat::kJson : LogFormat::kText);
  check_role(settings);
  check_addresses(settings);
  cellmap::auth::Guard guard({.tokens = settings.tokens, .requests_per_s = settings.rate_limit});
  std::unique_ptr<cellmap::server::AuditLog> audit;
  if (!settings.audit.empty()) {
    audit = std::make_unique<cellmap::server::AuditLog>(settings.audit);
  }
  if (guard.asks_for_tokens()) log->info("knows {} tokens", guard.token_count());

  auto options = api_options(settings);
  options.guard = &guard;
  options.audit = audit.get();
  const auto store = cellmap::open_store(settings.store, objects_of(settings));
  cellmap::server::Api api(*store, std::move(options), log);
  cellmap::server::HttpServer server(api, log, http_options(settings));
  for (const std::string& url : server.urls()) {
    std::cout << "cellmapd listens on " << url << std::endl;
  }
  std::thread signal_thread = heed_signals(signals, api, server, audit.get(), *log);
  server.run();
  signal_thread.join();
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const auto read = cellmap::server::read_settings({argv + 1, argv + argc}, std::cout, std::cerr);
    if (const int* code = std::get_if<int>(&read)) return *code;
    serve(std::get<Settings>(read));
  } catch (const Error& error) {
    std::cerr << "cellmapd: " << error.what() << '\n';
    return error.code() == ErrorCode::kInvalidArgument ? 2 : 1;
  } catch (const std::exception& error) {
    std::cerr << "cellmapd: " << error.what() << '\n';
    return 1;
  }
  return 0;
}
