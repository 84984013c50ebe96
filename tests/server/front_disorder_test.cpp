#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "server/http/front.hpp"
#include "server/http/send_answer.hpp"

namespace cellmap::server {
namespace {

/// Limits so small that all of them are met.
FrontOptions narrow() {
  FrontOptions options;
  options.quick_workers = 3;
  options.patient_workers = 4;
  options.max_waiting = 4;
  options.max_connections = 12;
  options.head_timeout = options.idle_timeout = std::chrono::milliseconds(100);
  return options;
}

bool answer(Connection& connection, const RequestHead& head, BodyFiles& files) {
  const AnswerForm form{.is_head = false, .is_http_1_0 = false, .keep = head.keep};
  Response response;
  response.body = std::string(head.target == "/long" ? 900'000 : 10, 'x');
  const bool fails = head.target == "/fails";
  connection.skip(head.size);
  if (fails) throw std::runtime_error("as asked");
  return send_answer(connection, response, form, files);
}

int connect_to(int port) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  const timeval patience{0, 200'000};
  ::setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof(patience));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ::connect(socket, reinterpret_cast<sockaddr*>(&address), sizeof(address));
  return socket;
}

std::string some_requests(std::mt19937& random) {
  constexpr std::array kTargets{"/", "/patient", "/long", "/fails", "/"};
  std::string requests;
  for (auto count = 1 + random() % 3; count > 0; --count) {
    requests.append("GET ").append(kTargets[random() % kTargets.size()]);
    requests.append(" HTTP/1.1\r\nHost: x\r\n\r\n");
  }
  return requests;
}

/// Sends requests whole, several at once or in two pieces, and leaves when it likes.
void disturb(int port, std::mt19937 random, const std::atomic<bool>& done) {
  while (!done) {
    const int socket = connect_to(port);
    bool goes_on = true;
    while (goes_on && !done) {
      const std::string requests = some_requests(random);
      const std::size_t cut = random() % requests.size();
      goes_on = ::send(socket, requests.data(), cut, MSG_NOSIGNAL) >= 0;
      if (random() % 4 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(random() % 3));
      goes_on = goes_on &&
                ::send(socket, requests.data() + cut, requests.size() - cut, MSG_NOSIGNAL) >= 0;
      std::array<char, 4096> some;  // of the answers
      goes_on = goes_on && random() % 5 != 0 && ::recv(socket, some.data(), some.size(), 0) > 0;
    }
    ::close(socket);
  }
}

TEST(Front, ServesOnAndStopsWhateverItsClientsDo) {
  std::vector<Listener> listeners;
  listeners.emplace_back("127.0.0.1:0");
  const int port = listeners.front().port();
  std::atomic<int> served = 0;
  std::atomic<bool> done = false;
  BodyFiles files;
  Front front(std::move(listeners), narrow(),
              {[](const RequestHead& head) { return head.target == "/patient"; },
               [&](Connection& connection, const RequestHead& head) {
                 ++served;
                 return answer(connection, head, files);
               },
               [](const std::exception&) {}});
  std::thread loop([&] { front.run(); });
  std::vector<std::thread> clients;
  for (unsigned seed = 0; seed < 16; ++seed) {
    clients.emplace_back([&, seed] { disturb(port, std::mt19937(seed), done); });
  }
  while (served < 500) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  front.stop();
  loop.join();  // while they go on
  done = true;
  for (std::thread& client : clients) client.join();
}

}  // namespace
}  // namespace cellmap::server
