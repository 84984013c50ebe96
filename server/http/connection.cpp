#include "server/http/connection.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/sendfile.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "server/http/client_address.hpp"

namespace cellmap::server {
namespace {

constexpr std::size_t kBlockBytes = 64u << 10;
/// Up to here pieces are joined; a longer one is sent from where it lies.
constexpr std::size_t kJoinBytes = 16u << 10;

bool would_block() { return errno == EAGAIN || errno == EWOULDBLOCK; }

}  // namespace

Connection::Connection(int socket, const ConnectionLimits& limits, const std::atomic<bool>& stop)
    : socket_(socket), limits_(limits), stop_(stop), start_(Clock::now()) {}

Connection::~Connection() { ::close(socket_); }

const std::string& Connection::address() const {
  if (!address_.empty()) return address_;
  sockaddr_storage peer{};
  socklen_t size = sizeof(peer);
  if (::getpeername(socket_, reinterpret_cast<sockaddr*>(&peer), &size) != 0) {
    return address_ = "unknown";
  }
  if (peer.ss_family == AF_UNIX) return address_ = "unix";
  const void* bytes = &reinterpret_cast<sockaddr_in&>(peer).sin_addr;
  if (peer.ss_family == AF_INET6) bytes = &reinterpret_cast<sockaddr_in6&>(peer).sin6_addr;
  char text[INET6_ADDRSTRLEN] = "";
  ::inet_ntop(peer.ss_family, bytes, text, sizeof(text));
  return address_ = address_name(text).value_or("unknown");
}

bool Connection::receive() {
  if (begin_ == input_.size()) {
    input_.clear();
    begin_ = 0;
  }
  std::array<char, kBlockBytes> block;
  ssize_t received;
  do {
    received = ::recv(socket_, block.data(), block.size(), MSG_DONTWAIT);
  } while (received < 0 && errno == EINTR);
  if (received <= 0) return received < 0 && would_block();
  input_.append(block.data(), static_cast<std::size_t>(received));
  bytes_received_ += static_cast<std::size_t>(received);
  return true;
}

void Connection::begin(bool patient) {
  patient_ = patient;
  at_once_ = false;
  start_ = Clock::now();
  bytes_received_ = 0;
}

Clock::time_point Connection::slowest(Clock::time_point start, std::chrono::milliseconds timeout,
                                      std::size_t bytes) const {
  return start + timeout + std::chrono::seconds(bytes / limits_.slowest_bytes_per_s);
}

/// In short steps, so that a stop is noticed.
bool Connection::wait(short events, Clock::time_point deadline) const {
  constexpr std::chrono::milliseconds kStep(100);
  for (;;) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(deadline - Clock::now());
    if (left.count() <= 0) return false;
    pollfd entry{socket_, events, 0};
    const int ready = ::poll(&entry, 1, static_cast<int>(std::min(left, kStep).count()) + 1);
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
    if (stop_ && events == POLLIN) return false;
  }
}

std::size_t Connection::read(char* data, std::size_t size) {
  if (begin_ == input_.size()) {
    if (!flush()) return 0;
    while (begin_ == input_.size()) {
      if (!wait(POLLIN, slowest(start_, limits_.read_timeout, bytes_received_))) return 0;
      if (!receive()) return 0;
    }
  }
  size = std::min(size, input_.size() - begin_);
  std::copy_n(input_.data() + begin_, size, data);
  begin_ += size;
  return size;
}

/// Sends what the socket takes of both, one after the other, and waits for it to take all where the
/// worker is patient.
bool Connection::send_now(std::string_view first, std::string_view second, std::size_t& sent) {
  const auto start = Clock::now();
  sent = 0;
  while (sent < first.size() + second.size()) {
    const auto rest = [](std::string_view part, std::size_t gone) {
      part.remove_prefix(std::min(gone, part.size()));
      return iovec{const_cast<char*>(part.data()), part.size()};
    };
    std::array<iovec, 2> parts = {rest(first, sent),
                                  rest(second, sent - std::min(sent, first.size()))};
    msghdr message{};
    message.msg_iov = parts.data();
    message.msg_iovlen = parts.size();
    const ssize_t taken = ::sendmsg(socket_, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (taken >= 0) {
      sent += static_cast<std::size_t>(taken);
    } else if (would_block()) {
      if (!patient_) return true;
      if (!wait(POLLOUT, slowest(start, limits_.write_timeout, sent))) return false;
    } else if (errno != EINTR) {
      return false;
    }
  }
  return true;
}

bool Connection::write(std::string_view data) {
  if (output_.size() + data.size() <= kJoinBytes) {
    output_.append(data);
    return !at_once_ || flush();
  }
  return send_with_output(data);
}

/// True where all that waited is gone, and the kernel expects more in the same segment.
bool Connection::send_before_more() {
  while (sent_ < output_.size()) {
    const ssize_t taken = ::send(socket_, output_.data() + sent_, output_.size() - sent_,
                                 MSG_MORE | MSG_NOSIGNAL | MSG_DONTWAIT);
    if (taken < 0) return false;  // what is wrong the next call finds out
    sent_ += static_cast<std::size_t>(taken);
  }
  return true;
}

bool Connection::write_of_file(std::string_view data, int file, std::size_t offset) {
  if (!data.empty() && send_before_more()) {
    auto begin = static_cast<off_t>(offset);
    const ssize_t taken = ::sendfile(socket_, file, &begin, data.size());
    if (taken > 0) data.remove_prefix(static_cast<std::size_t>(taken));
  }
  return send_with_output(data);
}

bool Connection::flush() { return send_with_output({}); }

/// What waits and then `data`, in one call; what the socket does not take waits.
bool Connection::send_with_output(std::string_view data) {
  const std::string_view waiting = std::string_view(output_).substr(sent_);
  std::size_t sent = 0;
  if (!send_now(waiting, data, sent)) return false;
  if (sent < waiting.size()) {
    sent_ += sent;
    output_.append(data);
    return true;
  }
  data.remove_prefix(sent - waiting.size());
  output_.assign(data);
  sent_ = 0;
  return true;
}

bool Connection::send_pending() {
  patient_ = false;
  return flush();
}

void Connection::half_close() { ::shutdown(socket_, SHUT_WR); }

bool Connection::discard() {
  input_.clear();
  begin_ = 0;
  std::array<char, 16384> waste;
  for (;;) {
    const ssize_t received = ::recv(socket_, waste.data(), waste.size(), MSG_DONTWAIT);
    if (received == 0) return false;
    if (received < 0) return would_block() || errno == EINTR;
  }
}

bool Connection::is_closed_by_peer() const {
  char byte;
  const ssize_t received = ::recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
  return received == 0 || (received < 0 && !would_block() && errno != EINTR);
}

}  // namespace cellmap::server
