#include "server/http/front.hpp"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <optional>
#include <thread>
#include <vector>

#include "cellmap/core/error.hpp"
#include "server/api/problem.hpp"
#include "server/http/clients.hpp"
#include "server/http/poll.hpp"
#include "server/http/quick_workers.hpp"
#include "server/http/send_answer.hpp"
#include "server/http/workers.hpp"

namespace cellmap::server {
namespace {

/// How often timeouts are looked at, and requests that no worker takes.
constexpr std::chrono::milliseconds kTick(100);
/// How long a closing connection may still be sending, so that its peer reads the answer before the
/// reset.
constexpr std::chrono::milliseconds kCloseTimeout(1'000);
/// What the kernel may hold of an answer: nearly all CELLs, so that they are handed over at once.
constexpr int kSendBufferBytes = 256 << 10;
/// Requests of one connection that a worker answers in a row before others get a turn.
constexpr int kRequestsInARow = 16;

std::size_t quick_workers(const FrontOptions& options) {
  if (options.quick_workers > 0) return options.quick_workers;
  const std::size_t processors = std::max(2u, std::thread::hardware_concurrency());
  return options.waits_for_database ? 8 * processors : processors;
}

/// Two save a tenth of what workers cost each other, and four no more; but the second waits for the
/// first.
std::size_t sockets_at_once(const FrontOptions& options) {
  return options.waits_for_database ? 1 : 2;
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
        clients([this](const Client& client) { watch(client); }),
        quick(quick_workers(options), sockets_at_once(options), options.max_waiting,
              [this](int socket) { on_ready(socket, true); }),
        patient(options.patient_workers, options.max_waiting) {
    std::signal(SIGPIPE, SIG_IGN);  // sendfile has no MSG_NOSIGNAL
    poll.watch(stop_bell.descriptor());
    for (const Listener& listener : listeners) poll.watch(listener.socket());
  }

  void run() {
    quick.start();
    auto next_tick = Clock::now() + kTick;
    while (!stopping) {
      wait();
      if (Clock::now() < next_tick) continue;
      expire();
      if (!quick.has_idle()) take_over();
      next_tick = Clock::now() + kTick;
    }
    end();
  }

  void wait() {
    std::array<epoll_event, 128> events;
    for (const epoll_event& event : poll.wait(events, kTick)) {
      handle(event.data.fd);
    }
  }

  void handle(int socket) {
    if (socket == stop_bell.descriptor()) return void(stop_bell.hear());
    for (const Listener& listener : listeners) {
      if (socket == listener.socket()) return accept_all(socket);
    }
    on_ready(socket, false);
  }

  /// Idle connections are watched by the quick workers, all others by the loop.
  void watch(const Client& client) const {
    const int socket = client.connection.socket();
    if (client.phase == Phase::kIdle) return quick.watch(socket);
    poll.watch_once(socket, client.phase == Phase::kSending ? EPOLLOUT : EPOLLIN);
  }

  /// What comes while all quick workers are at work waits in their queue, which is bounded.
  void take_over() {
    for (const int socket : quick.take_ready()) on_ready(socket, false);
  }

  // Coming and going.

  void accept_all(int listener) {
    for (;;) {
      const int socket = ::accept4(listener, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
      if (socket < 0) {
        if (errno == EINTR || errno == ECONNABORTED) continue;
        // Out of descriptors: an idle connection gives its own, or the next tick tries again.
        const bool is_full = errno == EMFILE || errno == ENFILE;
        if (is_full && clients.remove_longest_idle()) continue;
        if (is_full) poll.ignore(listener);
        return;
      }
      add(socket);
    }
  }

  void add(int socket) {
    const int yes = 1;
    ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof(yes));  // fails for a unix socket
    ::setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &kSendBufferBytes, sizeof(kSendBufferBytes));
    if (clients.size() >= options.max_connections && !clients.remove_longest_idle()) {
      const std::string answer = own_answer(overloaded());
      ::send(socket, answer.data(), answer.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
      ::close(socket);
      return;
    }
    clients.add(std::make_unique<Client>(socket, options.connection, stopping));
  }

  void park(Client& client, Phase phase) {
    clients.park(client, phase);
    if (stopping) stop_bell.ring();  // the loop may wait for it
  }

  void close(Client& client) {
    clients.remove(client);
    if (stopping) stop_bell.ring();
  }

  void expire() {
    const auto now = Clock::now();
    for (Client* client : clients.take_if([&](const Client& c) { return is_late(c, now); })) {
      if (client->phase == Phase::kHead) {
        answer(*client, problem_with_status(408, ErrorCode::kUnavailable,
                                            "The head of the request took too long."));
      } else {
        close(*client);
      }
    }
    for (const Listener& listener : listeners) poll.watch(listener.socket());
  }

  bool is_late(const Client& client, Clock::time_point now) const {
    switch (client.phase) {
      case Phase::kIdle:
        return now - client.since > options.idle_timeout;
      case Phase::kHead:
        return now - client.head_begun.value_or(client.since) > options.head_timeout;
      case Phase::kClosing:
        return now - client.since > kCloseTimeout;
      case Phase::kSending:
        break;
    }
    const auto& limits = options.connection;
    const std::size_t sent = client.to_send - client.connection.pending();
    return now - client.since >
           limits.write_timeout + std::chrono::seconds(sent / limits.slowest_bytes_per_s);
  }

  // Heads.

  /// By the loop, or by a quick worker, which answers at once what it may.
  void on_ready(int socket, bool by_worker) {
    Client* const client = clients.take(socket);
    if (!client) return;
    switch (client->phase) {
      case Phase::kIdle:
      case Phase::kHead:
        if (!client->connection.receive()) return close(*client);
        return by_worker ? serve(*client, false) : look(*client);
      case Phase::kSending:
        if (!client->connection.send_pending()) return close(*client);
        if (client->connection.pending() == 0) return after_answer(*client);
        return clients.park_again(*client);
      case Phase::kClosing:
        if (!client->connection.discard()) return close(*client);
        return clients.park_again(*client);
    }
  }

  /// Looks at what came: a head to serve, to refuse, or to wait for.
  void look(Client& client) {
    const auto reading = read_request_head(client.connection.input(), options.head);
    if (reading.refusal) return answer(client, *reading.refusal);
    if (reading.head) return dispatch(client, *reading.head);
    if (client.connection.input().empty()) return park(client, Phase::kIdle);
    if (!client.head_begun) client.head_begun = Clock::now();
    park(client, Phase::kHead);
  }

  bool is_patient(const Connection& connection, const RequestHead& head) const {
    const bool is_whole = connection.input().size() - head.size >= head.content_length;
    return head.chunked || !is_whole || handlers.may_wait(head);
  }

  void dispatch(Client& client, const RequestHead& head) {
    const bool waits = is_patient(client.connection, head);
    const auto work = [this, &client, waits] { serve(client, waits); };
    if (!(waits ? patient.put(work) : quick.put(work))) answer(client, overloaded());
  }

  std::string own_answer(Response response) const {
    if (handlers.complete) handlers.complete(response);
    const auto body = body_view(response);
    return answer_head(response, {.keep = false}, body.size()).append(body);
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
      client.head_begun.reset();
      connection.begin(patient_worker);
      try {
        client.keep = handlers.serve(connection, *reading.head) && !stopping;
      } catch (const std::exception& error) {
        handlers.on_failure(error);
        return close(client);
      }
      if (!connection.flush()) return close(client);
      if (!client.keep || connection.pending() > 0) return after_answer(client);
    }
    look(client);
  }

  // The end.

  void end() {
    for (Listener& listener : listeners) listener.close();
    clients.remove_if([](const Client& client) {
      return client.phase == Phase::kIdle || client.phase == Phase::kHead;
    });
    const auto deadline = Clock::now() + options.stop_timeout;
    while (clients.is_any_answered() && Clock::now() < deadline) {
      wait();
      const auto now = Clock::now();
      clients.remove_if([&](const Client& client) {
        return client.phase == Phase::kIdle || is_late(client, now);
      });
    }
    quick.finish();
    patient.finish();
    clients.remove_if([](const Client&) { return true; });
  }

  std::vector<Listener> listeners;
  const FrontOptions options;
  const FrontHandlers handlers;
  std::atomic<bool> stopping = false;
  const Poll poll;  ///< of the loop
  const Bell stop_bell{false};
  Clients clients;
  QuickWorkers quick;
  Workers patient;
};

Front::Front(std::vector<Listener> listeners, FrontOptions options, FrontHandlers handlers)
    : impl_(std::make_unique<Impl>(std::move(listeners), std::move(options), std::move(handlers))) {
}
Front::~Front() = default;

void Front::run() { impl_->run(); }

void Front::stop() {
  impl_->stopping = true;
  impl_->stop_bell.ring();
}

bool Front::is_stopping() const { return impl_->stopping; }

}  // namespace cellmap::server
