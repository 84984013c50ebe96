#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <spdlog/sinks/null_sink.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "server/http_server.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {

/// A connection to the server under test.
class Client {
 public:
  explicit Client(int port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval patience{20, 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  explicit Client(const std::string& path) : socket_(::socket(AF_UNIX, SOCK_STREAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.copy(address.sun_path, sizeof(address.sun_path) - 1);
    connected_ = ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~Client() { ::close(socket_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  bool is_connected() const { return connected_; }

  /// False where the server has closed.
  bool send(const std::string& text) {
    return ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(text.size());
  }

  /// Reads until `text` was seen, `size` bytes came, the server closes or patience ends; returns
  /// all of it.
  std::string read_until(const std::string& text, std::size_t size = SIZE_MAX) {
    std::string all;
    char buffer[4096];
    while (all.size() < size && all.find(text) == std::string::npos) {
      const ssize_t received = ::recv(socket_, buffer, sizeof(buffer), 0);
      if (received <= 0) break;
      all.append(buffer, static_cast<std::size_t>(received));
    }
    return all;
  }
  std::string read_all() { return read_until("\x01never"); }

 private:
  int socket_;
  bool connected_;
};

/// A server over loopback. `Base` has the API and the folder.
template <class Base>
class HttpTest : public Base {
 protected:
  void serve(HttpServerOptions options = {}) {
    const auto log =
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::null_sink_mt>());
    server_ = std::make_unique<HttpServer>(*this->api_, log, options);
    thread_ = std::thread([this] { server_->run(); });
  }
  ~HttpTest() override {
    if (!server_) return;
    this->api_->stop();
    server_->stop();
    thread_.join();
  }

  std::string exchange(const std::string& request) {
    Client client(server_->port());
    client.send(request);
    return client.read_all();
  }
  std::string get_and_close(const std::string& target, const std::string& headers = "") {
    return exchange("GET " + target + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" + headers +
                    "\r\n");
  }

  std::unique_ptr<HttpServer> server_;
  std::thread thread_;
};

}  // namespace cellmap::server::test
