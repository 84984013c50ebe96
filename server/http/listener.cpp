#include "server/http/listener.hpp"

#include <arpa/inet.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <memory>
#include <utility>

#include "cellmap/core/error.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

constexpr std::string_view kUnix = "unix:";
constexpr std::uint64_t kLastPort = 65535, kNoPort = kLastPort + 1;

[[noreturn]] void cannot_listen(const std::string& address, const std::string& why) {
  throw Error(ErrorCode::kIo, "Cannot listen on " + address + ": " + why +
                                  ". Is the address this machine's and free?");
}

struct HostAndPort {
  std::string host, port;
};

HostAndPort split_address(const std::string& address) {
  const auto colon = address.rfind(':');
  const std::string digits = colon == std::string::npos ? "" : address.substr(colon + 1);
  const std::uint64_t port = parse_unsigned(digits).value_or(kNoPort);
  std::string host = address.substr(0, colon);
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  if (port > kLastPort || host.empty()) {
    throw Error(ErrorCode::kInvalidArgument,
                "Expected an address HOST:PORT such as 127.0.0.1:8080 or [::1]:8080, or "
                "unix:/path, found " +
                    in_quotes(address) + ".");
  }
  return {std::move(host), std::to_string(port)};
}

int port_of(int socket) {
  sockaddr_storage bound{};
  socklen_t size = sizeof(bound);
  if (::getsockname(socket, reinterpret_cast<sockaddr*>(&bound), &size) != 0) return 0;
  return ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<sockaddr_in6&>(bound).sin6_port
                                           : reinterpret_cast<sockaddr_in&>(bound).sin_port);
}

}  // namespace

Listener::Listener(const std::string& address) {
  if (address.starts_with(kUnix)) {
    listen_on_unix(address.substr(kUnix.size()));
  } else {
    const auto [host, port] = split_address(address);
    listen_on_tcp(host, port);
  }
}

Listener::Listener(Listener&& other) noexcept
    : socket_(std::exchange(other.socket_, -1)),
      port_(other.port_),
      url_(std::move(other.url_)),
      path_(std::exchange(other.path_, {})) {}

Listener::~Listener() { close(); }

void Listener::close() {
  if (socket_ >= 0) ::close(std::exchange(socket_, -1));
  if (!path_.empty()) ::unlink(std::exchange(path_, {}).c_str());
}

void Listener::listen_on_unix(const std::string& path) {
  const std::string address = std::string(kUnix) + path;
  sockaddr_un name{};
  name.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof(name.sun_path)) {
    throw Error(ErrorCode::kInvalidArgument, "The path of a unix socket has 1 to " +
                                                 std::to_string(sizeof(name.sun_path) - 1) +
                                                 " bytes, found " + in_quotes(path) + ".");
  }
  path.copy(name.sun_path, path.size());
  struct stat found {};
  if (::lstat(path.c_str(), &found) == 0) {
    if (!S_ISSOCK(found.st_mode)) cannot_listen(address, "there is a file that is no socket");
    // A server that was killed leaves its socket behind; one that lives answers.
    const int probe = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const bool lives =
        ::connect(probe, reinterpret_cast<const sockaddr*>(&name), sizeof(name)) == 0;
    ::close(probe);
    if (lives) cannot_listen(address, "another server listens there");
    ::unlink(path.c_str());
  }
  socket_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (socket_ < 0 || ::bind(socket_, reinterpret_cast<const sockaddr*>(&name), sizeof(name)) != 0 ||
      ::listen(socket_, SOMAXCONN) != 0) {
    const std::string why = std::strerror(errno);
    close();
    cannot_listen(address, why);
  }
  path_ = path;
  url_ = address;
}

void Listener::listen_on_tcp(const std::string& host, const std::string& port) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE | AI_NUMERICSERV;
  addrinfo* list = nullptr;
  const std::string address = host + ":" + port;
  if (const int error = ::getaddrinfo(host.c_str(), port.c_str(), &hints, &list); error != 0) {
    cannot_listen(address, ::gai_strerror(error));
  }
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(list, &::freeaddrinfo);
  std::string why;
  for (const addrinfo* entry = list; entry; entry = entry->ai_next) {
    socket_ = ::socket(entry->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const int yes = 1;
    ::setsockopt(socket_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof(yes));
    if (socket_ >= 0 && ::bind(socket_, entry->ai_addr, entry->ai_addrlen) == 0 &&
        ::listen(socket_, SOMAXCONN) == 0) {
      break;
    }
    why = std::strerror(errno);
    close();
  }
  if (socket_ < 0) cannot_listen(address, why);
  port_ = port_of(socket_);
  const bool is_v6 = host.find(':') != std::string::npos;
  url_ = "http://" + (is_v6 ? "[" + host + "]" : host) + ":" + std::to_string(port_);
}

bool is_local(const std::string& address) {
  if (address.starts_with(kUnix)) return true;
  const std::string host = split_address(address).host;
  in_addr ip{};
  const bool is_ip = ::inet_pton(AF_INET, host.c_str(), &ip) == 1;  // no name such as 127.example
  return host == "localhost" || host == "::1" || (is_ip && host.starts_with("127."));
}

}  // namespace cellmap::server
