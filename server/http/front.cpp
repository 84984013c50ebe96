#include "server/http/front.hpp"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <vector>

#include "cellmap/core/error.hpp"
#include "server/api/problem.hpp"
#include "server/http/workers.hpp"

namespace cellmap::server {
namespace {

/// How often timeouts are looked at.
constexpr std::chrono::milliseconds kTick(100);
/// How long a closing connection may still be sending, so that its peer reads the answer before the
/// reset.
constexpr std::chrono::milliseconds kCloseTimeout(1'000);
/// What the kernel may hold of an answer: nearly all CELLs, so that they are handed over at once.
constexpr int kSendBufferBytes = 256 << 10;
/// Requests of one connection that a worker answers in a row before others get a turn.
constexpr int kRequestsInARow = 16;

/// A file descriptor that is closed.
struct Descriptor {
  explicit Descriptor(int value_in) : value(value_in) {
    if (value < 0) throw Error(ErrorCode::kIo, std::string("epoll: ") + std::strerror(errno));
  }
  ~Descriptor() { ::close(value); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  const int value;
};

enum class Phase { kIdle, kHead, kServed, kSending, kClosing };

struct Client {
  Client(int socket, const ConnectionLimits& limits, const std::atomic<bool>& stop)
      : connection(socket, limits, stop) {}

  Connection connection;
  std::atomic<Phase> phase = Phase::kIdle;
  std::atomic<Clock::time_point> since = Clock::now();  ///< in this phase
  bool keep = true;                                     ///< after what is being sent
  std::size_t to_send = 0;                              ///< when that began

  void enter(Phase next) {
    since = Clock::now();
    phase = next;
  }
};

std::string whole_answer(const Response& response) {
  const auto body = body_view(response);
  std::string text = "HTTP/1.1 " + std::to_string(response.status) + " Refused\r\n";
  for (const auto& [name, value] : response.headers.fields()) text += name + ": " + value + "\r\n";
  text += "Content-Length: " + std::to_string(body.size()) + "\r\nConnection: close\r\n\r\n";
  return text.append(body);
}

Response overloaded() {
  Response response =
      problem(ErrorCode::kUnavailable, "The server has more requests than it can answer now.");
  response.headers.set("Retry-After", "1");
  return response;
}

}  // namespace

struct Front::Impl {
  Impl(std::vector<Listener> listeners_in, FrontOptions options_in, FrontHandlers handlers_in)
      : listeners(std::move(listeners_in)),
        options(std::move(options_in)),
        handlers(std::move(handlers_in)),
        quick(options.quick_workers, options.max_waiting),
        patient(options.patient_workers, options.max_waiting) {
    watch(wake.value, EPOLLIN, EPOLL_CTL_ADD);
    for (const Listener& listener : listeners) watch(listener.socket(), EPOLLIN, EPOLL_CTL_ADD);
  }

  void run() {
    std::array<epoll_event, 128> events;
    auto next_tick = Clock::now() + kTick;
    while (!stopping) {
      const int ready = ::epoll_wait(epoll.value, events.data(), events.size(), kTick.count());
      for (int i = 0; i < ready; ++i) handle(events[static_cast<std::size_t>(i)].data.fd);
      if (Clock::now() < next_tick) continue;
      expire();
      next_tick = Clock::now() + kTick;
    }
    end();
  }

  void handle(int socket) {
    if (socket == wake.value) return take_back();
    for (const Listener& listener : listeners) {
      if (socket == listener.socket()) return accept_all(socket);
    }
    if (const auto found = clients.find(socket); found != clients.end()) on_ready(*found->second);
  }

  /// Once: the next event comes when the socket is watched again.
  void watch(int socket, std::uint32_t events, int operation) const {
    epoll_event event{};
    event.events = events;
    event.data.fd = socket;
    ::epoll_ctl(epoll.value, operation, socket, &event);
  }
  void park(Client& client, Phase phase) const {
    client.enter(phase);
    const std::uint32_t direction = phase == Phase::kSending ? EPOLLOUT : EPOLLIN;
    watch(client.connection.socket(), direction | EPOLLONESHOT, EPOLL_CTL_MOD);
  }

  // Coming and going.

  void accept_all(int listener) {
    for (;;) {
      const int socket = ::accept4(listener, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (socket < 0) {
        if (errno == EINTR || errno == ECONNABORTED) continue;
        // Out of descriptors: an idle connection gives its own, or the next tick tries again.
        if ((errno == EMFILE || errno == ENFILE) && make_room()) continue;
        if (errno == EMFILE || errno == ENFILE) watch(listener, 0, EPOLL_CTL_MOD);
        return;
      }
      add(socket);
    }
  }

  void add(int socket) {
    const int yes = 1;
    ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof(yes));  // fails for a unix socket
    ::setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &kSendBufferBytes, sizeof(kSendBufferBytes));
    if (clients.size() >= options.max_connections && !make_room()) {
      const std::string answer = own_answer(overloaded());
      ::send(socket, answer.data(), answer.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
      ::close(socket);
      return;
    }
    clients.emplace(socket, std::make_unique<Client>(socket, options.connection, stopping));
    watch(socket, EPOLLIN | EPOLLONESHOT, EPOLL_CTL_ADD);
  }

  /// Closes the connection that has been idle for longest. False where none is.
  bool make_room() {
    const std::lock_guard lock(mutex);
    Client* oldest = nullptr;
    for (const auto& [socket, client] : clients) {
      if (client->phase != Phase::kIdle) continue;
      if (!oldest || client->since.load() < oldest->since.load()) oldest = client.get();
    }
    if (oldest) clients.erase(oldest->connection.socket());
    return oldest != nullptr;
  }

  /// epoll forgets it. Locked, so that a worker that has just parked it is done with its socket.
  void close(Client& client) {
    const std::lock_guard lock(mutex);
    clients.erase(client.connection.socket());
  }

  void expire() {
    const auto now = Clock::now();
    std::vector<Client*> late;
    {
      const std::lock_guard lock(mutex);
      for (const auto& [socket, client] : clients) {
        const auto timeout = timeout_of(*client);
        if (timeout && now - client->since.load() > *timeout) late.push_back(client.get());
      }
    }
    for (Client* client : late) {
      if (client->phase == Phase::kHead) {
        answer(*client, problem_with_status(408, ErrorCode::kUnavailable,
                                            "The head of the request took too long."));
      } else {
        close(*client);
      }
    }
    for (const Listener& listener : listeners) watch(listener.socket(), EPOLLIN, EPOLL_CTL_MOD);
  }

  std::optional<std::chrono::milliseconds> timeout_of(const Client& client) const {
    switch (client.phase) {
      case Phase::kIdle:
        return options.idle_timeout;
      case Phase::kHead:
        return options.head_timeout;
      case Phase::kClosing:
        return kCloseTimeout;
      case Phase::kSending: {
        const auto& limits = options.connection;
        const std::size_t sent = client.to_send - client.connection.pending();
        return limits.write_timeout + std::chrono::seconds(sent / limits.slowest_bytes_per_s);
      }
      case Phase::kServed:
        break;
    }
    return std::nullopt;
  }

  // Heads.

  void on_ready(Client& client) {
    switch (client.phase) {
      case Phase::kIdle:
      case Phase::kHead:
        if (!client.connection.receive()) return close(client);
        return look(client);
      case Phase::kSending:
        if (!client.connection.send_pending()) return close(client);
        if (client.connection.pending() == 0) return after_answer(client);
        watch(client.connection.socket(), EPOLLOUT | EPOLLONESHOT, EPOLL_CTL_MOD);
        return;
      case Phase::kClosing:
        if (!client.connection.discard()) return close(client);
        watch(client.connection.socket(), EPOLLIN | EPOLLONESHOT, EPOLL_CTL_MOD);
        return;
      case Phase::kServed:
        return;
    }
  }

  /// Looks at what came: a head to serve, to refuse, or to wait for.
  void look(Client& client) {
    const auto reading = read_request_head(client.connection.input(), options.head);
    if (reading.refusal) return answer(client, *reading.refusal);
    if (reading.head) return dispatch(client, *reading.head);
    if (client.connection.input().empty()) return park(client, Phase::kIdle);
    const auto begun = client.phase == Phase::kHead ? client.since.load() : Clock::now();
    park(client, Phase::kHead);
    client.since = begun;
  }

  bool is_patient(const Connection& connection, const RequestHead& head) const {
    const bool is_whole = connection.input().size() - head.size >= head.content_length;
    return head.chunked || !is_whole || handlers.may_wait(head);
  }

  void dispatch(Client& client, const RequestHead& head) {
    client.enter(Phase::kServed);
    const bool waits = is_patient(client.connection, head);
    Workers& workers = waits ? patient : quick;
    if (!workers.put([this, &client, waits] { serve(client, waits); })) {
      answer(client, overloaded());
    }
  }

  std::string own_answer(Response response) const {
    if (handlers.complete) handlers.complete(response);
    return whole_answer(response);
  }

  /// The front's own answer; the connection ends after it.
  void answer(Client& client, Response response) {
    client.keep = false;
    client.connection.begin(false);
    if (!client.connection.write(own_answer(std::move(response))) || !client.connection.flush()) {
      return close(client);
    }
    after_answer(client);
  }

  void after_answer(Client& client) {
    if (client.connection.pending() > 0) {
      client.to_send = client.connection.pending();
      return park(client, Phase::kSending);
    }
    if (client.keep) return look(client);
    client.connection.half_close();
    park(client, Phase::kClosing);
  }

  // Workers.

  /// Answers the request that has come, and the next ones that a worker of this kind may answer and
  /// that are there already.
  void serve(Client& client, bool patient_worker) {
    Connection& connection = client.connection;
    for (int i = 0; i < kRequestsInARow; ++i) {
      const auto reading = read_request_head(connection.input(), options.head);
      if (!reading.head || is_patient(connection, *reading.head) != patient_worker) break;
      connection.begin(patient_worker);
      try {
        client.keep = handlers.serve(connection, *reading.head) && !stopping;
      } catch (const std::exception& error) {
        handlers.on_failure(error);
        return give_back(client, true);
      }
      if (!connection.flush()) return give_back(client, true);
      if (!client.keep || connection.pending() > 0) return give_back(client, false);
      if (connection.input().empty() && !connection.receive()) return give_back(client, true);
    }
    if (!connection.input().empty()) return give_back(client, false);
    // Without a detour through the loop. Locked, because it looks at idle clients from its side.
    const std::lock_guard lock(mutex);
    park(client, Phase::kIdle);
  }

  void give_back(Client& client, bool broken) {
    {
      const std::lock_guard lock(mutex);
      returned.push_back({&client, broken});
    }
    wake_up();
  }

  void take_back() {
    std::uint64_t count;
    while (::read(wake.value, &count, sizeof(count)) > 0) {
    }
    std::vector<Returned> clients_back;
    {
      const std::lock_guard lock(mutex);
      clients_back.swap(returned);
    }
    for (const auto& [client, broken] : clients_back) {
      broken ? close(*client) : after_answer(*client);
    }
  }

  void wake_up() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto written = ::write(wake.value, &one, sizeof(one));
  }

  // The end.

  bool is_anything_answered() const {
    for (const auto& [socket, client] : clients) {
      const Phase phase = client->phase;
      if (phase == Phase::kServed || phase == Phase::kSending || phase == Phase::kClosing) {
        return true;
      }
    }
    return false;
  }

  void end() {
    for (Listener& listener : listeners) listener.close();
    {
      const std::lock_guard lock(mutex);
      std::erase_if(clients, [](const auto& entry) {
        return entry.second->phase == Phase::kIdle || entry.second->phase == Phase::kHead;
      });
    }
    std::array<epoll_event, 128> events;
    const auto deadline = Clock::now() + options.stop_timeout;
    while (is_anything_answered() && Clock::now() < deadline) {
      const int ready = ::epoll_wait(epoll.value, events.data(), events.size(), kTick.count());
      for (int i = 0; i < ready; ++i) handle(events[static_cast<std::size_t>(i)].data.fd);
      expire_when_stopping();
    }
    quick.finish();
    patient.finish();
    clients.clear();
  }

  void expire_when_stopping() {
    const auto now = Clock::now();
    const std::lock_guard lock(mutex);
    std::erase_if(clients, [&](const auto& entry) {
      const auto timeout = timeout_of(*entry.second);
      return entry.second->phase == Phase::kIdle ||
             (timeout && now - entry.second->since.load() > *timeout);
    });
  }

  struct Returned {
    Client* client;
    bool broken;
  };

  std::vector<Listener> listeners;
  const FrontOptions options;
  const FrontHandlers handlers;
  std::atomic<bool> stopping = false;
  const Descriptor epoll{::epoll_create1(EPOLL_CLOEXEC)};
  const Descriptor wake{::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)};
  std::unordered_map<int, std::unique_ptr<Client>> clients;  ///< the loop's
  std::mutex mutex;  ///< of `returned`, and of who becomes idle
  std::vector<Returned> returned;
  Workers quick, patient;
};

Front::Front(std::vector<Listener> listeners, FrontOptions options, FrontHandlers handlers)
    : impl_(std::make_unique<Impl>(std::move(listeners), std::move(options), std::move(handlers))) {
}
Front::~Front() = default;

void Front::run() { impl_->run(); }

void Front::stop() {
  impl_->stopping = true;
  impl_->wake_up();
}

bool Front::is_stopping() const { return impl_->stopping; }

}  // namespace cellmap::server
