#pragma once

#include <spdlog/logger.h>

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>

#include "server/api/api.hpp"

namespace cellmap::server {

struct HttpServerOptions {
  std::string host = "127.0.0.1";
  int port = 0;                            ///< 0: any free one
  std::size_t max_connections = 512;       ///< served at a time, a thread each; more wait
  std::size_t max_head_bytes = 64u << 10;  ///< request line and header fields
  std::size_t max_header_fields = 100;
  std::chrono::seconds head_timeout{10};  ///< for a whole head once it has begun
  std::chrono::seconds body_timeout{60};  ///< for a whole body
  /// Of a body that goes into a file: `body_timeout` is without progress then, and this in all.
  std::chrono::seconds large_body_timeout{3600};
  std::chrono::seconds write_timeout{10};          ///< without progress
  std::chrono::milliseconds idle_timeout{30'000};  ///< of a kept connection
  /// Instead, while more than half of the connections are taken: idle clients make room soon.
  std::chrono::milliseconds busy_idle_timeout{1'000};
};

/// The socket front: reads requests within bounds, hands them to the API, writes what it answers.
/// HTTP/1.1 by cpp-httplib, which is seen in the .cpp only.
class HttpServer {
 public:
  /// Binds and listens. Throws Error{kInvalidArgument} for an address that is none, Error{kIo}
  /// where it is taken. The API must outlive the server.
  HttpServer(Api& api, std::shared_ptr<spdlog::logger> log, HttpServerOptions options);
  ~HttpServer();

  int port() const;
  /// Serves until `stop`. Call once.
  void run();
  /// Ends `run` after the requests that are being answered. Any thread.
  void stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap::server
