#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>
#include <vector>

#include "server/api/api.hpp"
#include "server/http/front.hpp"

namespace cellmap::server {

struct HttpServerOptions {
  std::vector<std::string> listen{"127.0.0.1:0"};  ///< as `Listener` has them
  FrontOptions front;
  std::vector<std::string> trusted_proxies;  ///< as `client_address` has them
};

/// The API behind sockets: the front (server/http) takes connections and heads, and answers what
/// has no body; cpp-httplib, which is seen in the .cpp only, reads bodies and answers those.
class HttpServer {
 public:
  /// Binds and listens. Throws what `Listener` throws. The API must outlive the server.
  HttpServer(Api& api, std::shared_ptr<spdlog::logger> log, HttpServerOptions options);
  ~HttpServer();

  int port() const;  ///< of the first address; 0 for a unix socket
  const std::vector<std::string>& urls() const;
  /// Serves until `stop`. Call once.
  void run();
  /// Ends `run` after the requests that are being answered. Any thread.
  void stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap::server
