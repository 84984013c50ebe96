#pragma once

#include <chrono>
#include <fstream>
#include <iterator>
#include <memory>
#include <string>

#include "cellmap/client/client.hpp"
#include "e2e/process.hpp"

namespace cellmap::test {

/// A real cellmapd on a loopback port.
class CellmapdProcess {
 public:
  /// Returns once it listens. `data_root` empty: none. `port` 0: any free one.
  CellmapdProcess(const std::filesystem::path& store, const std::filesystem::path& data_root = {},
                  int port = 0)
      : log_(store.string() + ".log"), process_(command(store, data_root, port), log_) {
    const std::string line = process_.read_line();
    const auto at = line.find("http://");
    if (at == std::string::npos) {
      std::ifstream log(log_);
      throw std::runtime_error("cellmapd printed no address but '" + line +
                               "': " + std::string(std::istreambuf_iterator<char>(log), {}));
    }
    url_ = line.substr(at, line.find_first_of(" \r\n", at) - at);
    while (url_.ends_with('/') || url_.ends_with('.')) url_.pop_back();
  }

  const std::string& url() const { return url_; }
  int port() const { return parse_server_url(url_).port; }

  /// A client that gives up soon.
  Client client(const std::filesystem::path& cache = {}) const {
    ClientOptions options;
    options.url = url_;
    options.cache_directory = cache;
    options.retry.attempts = 3;
    return Client(options);
  }

  /// SIGKILL: nothing is written any more.
  void kill() { process_.signal_and_wait(SIGKILL); }
  /// SIGTERM: a graceful stop; returns the exit code.
  int stop() { return process_.signal_and_wait(SIGTERM); }

 private:
  static std::vector<std::string> command(const std::filesystem::path& store,
                                          const std::filesystem::path& data_root, int port) {
    std::vector<std::string> command = {CELLMAPD_PROGRAM,
                                        "--store",
                                        store.string(),
                                        "--listen",
                                        "127.0.0.1:" + std::to_string(port),
                                        "--threads",
                                        "2"};
    if (!data_root.empty()) command.insert(command.end(), {"--data-root", data_root.string()});
    return command;
  }

  std::filesystem::path log_;
  Process process_;
  std::string url_;
};

}  // namespace cellmap::test
