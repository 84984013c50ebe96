#include "server/http/front.hpp"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
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

TEST(Front, WhatComesWhileAllQuickWorkersAreAtWorkWaitsOrIsRefusedAndTheOthersGoOn) {
  std::vector<Listener> listeners;
  listeners.emplace_back("127.0.0.1:0");
  const int port = listeners.front().port();
  FrontOptions options;
  options.quick_workers = 2;
  options.waits_for_database = true;  // so that each of them takes one of the slow ones
  options.max_waiting = 3;
  std::atomic<int> at_work = 0;
  std::atomic<bool> released = false;
  Front front(std::move(listeners), options,
              {[](const RequestHead& head) { return head.target == "/patient"; },
               [&](Connection& connection, const RequestHead& head) {
                 const bool is_slow = head.target == "/slow";
                 at_work += is_slow;
                 while (is_slow && !released) std::this_thread::yield();
                 connection.write(is_slow ? "slow" : "whole");
                 return false;
               },
               [](const std::exception&) {}});
  std::thread thread([&] { front.run(); });
  std::vector<std::thread> clients;
  std::atomic<int> slow = 0, answered = 0, refused = 0;
  for (int i = 0; i < 2; ++i) {
    clients.emplace_back([&] { slow += ask(port, "/slow") == "slow"; });
  }
  while (at_work < 2) std::this_thread::yield();
  for (int i = 0; i < 10; ++i) {
    clients.emplace_back([&] {
      const std::string answer = ask(port, "/");
      answered += answer == "whole";
      const bool is_told = answer.find("\r\nRetry-After: ") != std::string::npos;
      refused += is_told && answer.starts_with("HTTP/1.1 503");
    });
  }
  EXPECT_EQ(ask(port, "/patient"), "whole");
  // While the others wait.
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  while (refused < 7 && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
  EXPECT_EQ(answered, 0);
  released = true;
  for (std::thread& client : clients) client.join();
  EXPECT_EQ(slow, 2);
  EXPECT_EQ(answered, 3);
  EXPECT_EQ(refused, 7);
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
