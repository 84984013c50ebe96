#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <thread>

#include "cellmap/client/client.hpp"
#include "support/http_library.hpp"

namespace cellmap::test {

/// An HTTP server in this process that answers as a test tells it to, on a free loopback port.
class FakeServer {
 public:
  using Handler = std::function<void(const httplib::Request&, httplib::Response&)>;

  explicit FakeServer(Handler handler) : handler_(std::move(handler)) {
    const auto answer = [this](const httplib::Request& request, httplib::Response& response) {
      ++requests;
      handler_(request, response);
    };
    http_.Get(".*", answer);
    http_.Post(".*", answer);
    http_.Put(".*", answer);
    http_.Delete(".*", answer);
    http_.set_tcp_nodelay(true);
    port_ = http_.bind_to_any_port("127.0.0.1");
    thread_ = std::thread([this] { http_.listen_after_bind(); });
    while (!http_.is_running()) std::this_thread::yield();
  }
  ~FakeServer() {
    http_.stop();
    thread_.join();
  }

  std::string url() const { return "http://127.0.0.1:" + std::to_string(port_); }

  std::atomic<int> requests = 0;

 private:
  Handler handler_;
  httplib::Server http_;
  int port_ = 0;
  std::thread thread_;
};

inline void answer_json(httplib::Response& response, const std::string& json, int status = 200) {
  response.status = status;
  response.set_content(json, "application/json");
}

inline void answer_problem(httplib::Response& response, int status, const std::string& code,
                           const std::string& detail) {
  response.status = status;
  response.set_content(R"({"type":"/problems/)" + code + R"(","title":"t","status":)" +
                           std::to_string(status) + R"(,"detail":")" + detail + R"(","code":")" +
                           code + R"(","instance":"/"})",
                       "application/problem+json");
}

/// Options for `server` whose waits are written down instead of slept.
inline ClientOptions options_for(const FakeServer& server,
                                 std::vector<std::chrono::milliseconds>* waits = nullptr) {
  ClientOptions options;
  options.url = server.url();
  options.retry.jitter_seed = 1;
  options.retry.sleep = [waits](std::chrono::milliseconds wait) {
    if (waits) waits->push_back(wait);
  };
  return options;
}

}  // namespace cellmap::test
