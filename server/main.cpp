#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <filesystem>
#include <iostream>
#include <thread>

#include "cellmap/core/error.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "server/api/api.hpp"
#include "server/http_server.hpp"
#include "server/openapi_text.hpp"

// cellmapd: serves the maps of one store over HTTP.

namespace {

namespace fs = std::filesystem;
using cellmap::Error;
using cellmap::ErrorCode;

struct Flags {
  std::string store;
  std::vector<std::string> listen{"127.0.0.1:8080"};
  std::vector<std::string> data_roots;
  std::string viewer;
  int threads = 0;
  std::string log_level = "info";
  bool insecure = false;
};

void add_flags(CLI::App& app, Flags& flags) {
  app.set_version_flag("--version", "cellmapd " CELLMAP_VERSION);
  app.add_option("--store", flags.store, "The store's file; made where it is missing")->required();
  app.add_option("--listen", flags.listen,
                 "HOST:PORT (port 0: any free one) or unix:PATH (repeatable)")
      ->capture_default_str();
  app.add_option("--data-root", flags.data_roots,
                 "A folder that ingest jobs may read data sets from (repeatable)");
  app.add_option(
      "--viewer", flags.viewer,
      "Folder of the built viewer, served at /; default: the installed one, or the build "
      "tree's");
  app.add_option("--threads", flags.threads, "Threads of one computation; 0: all")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.add_option("--log-level", flags.log_level, "How much goes to standard error")
      ->check(CLI::IsMember({"trace", "debug", "info", "warn", "error", "off"}))
      ->capture_default_str();
  app.add_flag("--insecure", flags.insecure,
               "Listen beyond this machine although nobody is asked who they are");
  app.footer(
      "Example: cellmapd --store maps.db --listen 127.0.0.1:8080 --data-root ~/drives\n"
      "SIGTERM and SIGINT stop it; running jobs go on at the next start.");
}

cellmap::server::HttpServerOptions read_addresses(const Flags& flags) {
  for (const std::string& address : flags.listen) {
    if (!cellmap::server::is_local(address) && !flags.insecure) {
      throw Error(ErrorCode::kInvalidArgument,
                  address +
                      " is no loopback address, and this server asks nobody who they are: "
                      "listen on 127.0.0.1 behind a proxy, or say --insecure.");
    }
  }
  cellmap::server::HttpServerOptions options;
  options.listen = flags.listen;
  return options;
}

std::vector<fs::path> canonical_roots(const Flags& flags) {
  std::vector<fs::path> roots;
  for (const auto& root : flags.data_roots) {
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
fs::path viewer_folder(const Flags& flags) {
  if (!flags.viewer.empty()) return flags.viewer;
  std::error_code error;
  const fs::path here = fs::read_symlink("/proc/self/exe", error).parent_path();
  for (const char* place : {"../share/cellmap/web", "../web/dist"}) {
    if (!error && fs::is_regular_file(here / place / "index.html")) return here / place;
  }
  return {};
}

/// Stops the server at the first SIGTERM or SIGINT. The signals are blocked in every thread, so
/// that they wait here.
std::thread stop_on_signal(sigset_t signals, cellmap::server::Api& api,
                           cellmap::server::HttpServer& server, spdlog::logger& log) {
  return std::thread([signals, &api, &server, &log] {
    int signal = 0;
    sigwait(&signals, &signal);
    log.info("stops: jobs that run go on at the next start");
    server.stop();
    api.stop();
  });
}

void serve(const Flags& flags) {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);

  const auto log = std::make_shared<spdlog::logger>(
      "cellmapd", std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  log->set_level(spdlog::level::from_str(flags.log_level));
  const auto addresses = read_addresses(flags);

  cellmap::server::ApiOptions options;
  options.openapi = cellmap::server::openapi_text();
  options.viewer = viewer_folder(flags);
  options.threads = flags.threads;
  options.jobs.data_roots = canonical_roots(flags);
  options.spool_folder = fs::absolute(flags.store).parent_path();
  const auto store = cellmap::open_sqlite_store(flags.store);
  cellmap::server::Api api(*store, std::move(options), log);
  cellmap::server::HttpServer server(api, log, addresses);
  for (const std::string& url : server.urls()) {
    std::cout << "cellmapd listens on " << url << std::endl;
  }
  std::thread stopper = stop_on_signal(signals, api, server, *log);
  server.run();
  stopper.join();
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Serves the maps of one store over HTTP.", "cellmapd");
  Flags flags;
  add_flags(app, flags);
  CLI11_PARSE(app, argc, argv);
  try {
    serve(flags);
  } catch (const Error& error) {
    std::cerr << "cellmapd: " << error.what() << '\n';
    return error.code() == ErrorCode::kInvalidArgument ? 2 : 1;
  } catch (const std::exception& error) {
    std::cerr << "cellmapd: " << error.what() << '\n';
    return 1;
  }
  return 0;
}
