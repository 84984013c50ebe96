#pragma once

#include <string>
#include <vector>

namespace cellmap::server {

/// A socket that listens, with what clients call it.
class Listener {
 public:
  /// "127.0.0.1:8080", "[::1]:0" (0: any free port), "localhost:8080", or "unix:/run/cellmap.sock",
  /// whose file is made anew and taken away at the end. Throws Error{kInvalidArgument} for an
  /// address that is none, Error{kIo} where it is taken or not this machine's.
  explicit Listener(const std::string& address);
  ~Listener();
  Listener(Listener&& other) noexcept;
  Listener& operator=(Listener&&) = delete;

  int socket() const { return socket_; }
  int port() const { return port_; }               ///< 0 for a unix socket
  const std::string& url() const { return url_; }  ///< "http://127.0.0.1:8080" or "unix:/..."
  void close();                                    ///< no more connections

 private:
  void listen_on_unix(const std::string& path);
  void listen_on_tcp(const std::string& host, const std::string& port);

  int socket_ = -1;
  int port_ = 0;
  std::string url_, path_;
};

/// True where only this machine reaches the address: a loopback host or a unix socket.
bool is_local(const std::string& address);

}  // namespace cellmap::server
