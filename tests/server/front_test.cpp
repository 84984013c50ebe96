#include "server/http/front.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace cellmap::server {
namespace {

/// What the server at `port` answers before it closes.
std::string ask(int port, const std::string& target) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  const timeval patience{20, 0};
  ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer;
  if (::connect(socket, reinterpret_cast<sockaddr*>(&address), sizeof(address)) == 0) {
    const std::string request = "GET " + target + " HTTP/1.1\r\nHost: x\r\n\r\n";
    ::send(socket, request.data(), request.size(), MSG_NOSIGNAL);
    char buffer[256];
    for (ssize_t got; (got = ::recv(socket, buffer, sizeof(buffer), 0)) > 0;) {
      answer.append(buffer, static_cast<std::size_t>(got));
    }
  }
  ::close(socket);
  return answer;
}

TEST(Front, AnAnswerThatFailsHalfwayEndsItsConnectionAndNothingElse) {
  std::vector<Listener> listeners;
  listeners.emplace_back("127.0.0.1:0");
  const int port = listeners.front().port();
  std::atomic<int> failures = 0;
  Front front(std::move(listeners), {},
              {[](const RequestHead&) { return false; },
               [](Connection& connection, const RequestHead& head) {
                 const bool fails = head.target == "/broken";
                 connection.write(fails ? "half of " : "whole");
                 if (fails) throw std::runtime_error("the file cannot be read");
                 return false;
               },
               [&](const std::exception& error) {
                 EXPECT_STREQ(error.what(), "the file cannot be read");
                 ++failures;
               }});
  std::thread thread([&] { front.run(); });
  EXPECT_EQ(ask(port, "/broken"), "");
  EXPECT_EQ(ask(port, "/"), "whole");
  EXPECT_EQ(failures, 1);
  front.stop();
  thread.join();
}

TEST(Front, AnAnswerWaitsForNoAcknowledgement) {
  std::vector<Listener> listeners;
  listeners.emplace_back("127.0.0.1:0");
  const int port = listeners.front().port();
  std::atomic<int> no_delay = -1;
  Front front(std::move(listeners), {},
              {[](const RequestHead&) { return false; },
               [&](Connection& connection, const RequestHead&) {
                 int value = 0;
                 socklen_t size = sizeof(value);
                 ::getsockopt(connection.socket(), IPPROTO_TCP, TCP_NODELAY, &value, &size);
                 no_delay = value;
                 return false;
               },
               [](const std::exception&) {}});
  std::thread thread([&] { front.run(); });
  ask(port, "/");
  EXPECT_EQ(no_delay, 1);
  front.stop();
  thread.join();
}

/// True where the connection is made within the patience, without anybody accepting it.
bool is_made(int socket, const sockaddr_in& address) {
  if (::connect(socket, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0) {
    return true;
  }
  pollfd entry{socket, POLLOUT, 0};
  int error = -1;
  socklen_t size = sizeof(error);
  return ::poll(&entry, 1, 10'000) == 1 &&
         ::getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &size) == 0 && error == 0;
}

TEST(Front, AHundredConnectionsThatComeAtOnceAreHeldUntilTheyAreAccepted) {
  const Listener listener("127.0.0.1:0");
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(listener.port()));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::vector<int> sockets;
  for (int i = 0; i < 100; ++i) {
    sockets.push_back(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0));
    if (!is_made(sockets.back(), address)) {
      ADD_FAILURE() << "connection " << i;
      break;
    }
  }
  for (const int socket : sockets) ::close(socket);
}

}  // namespace
}  // namespace cellmap::server
