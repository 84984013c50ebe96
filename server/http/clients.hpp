#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <vector>

#include "server/http/connection.hpp"

namespace cellmap::server {

/// What a connection waits for: a request, the rest of a head, that its peer reads the answer, or
/// that it closes.
enum class Phase { kIdle, kHead, kSending, kClosing };

/// A connection. Belongs to the thread that took it, until that parks it.
struct Client {
  Client(int socket, const ConnectionLimits& limits, const std::atomic<bool>& stop)
      : connection(socket, limits, stop) {}

  Connection connection;
  bool is_parked = true;
  Phase phase = Phase::kIdle;                     ///< since it was parked last
  Clock::time_point since = Clock::now();         ///< it has been in this phase
  std::optional<Clock::time_point> head_begun{};  ///< when the head came that is not whole yet
  bool keep = true;                               ///< after what is being sent
  std::size_t to_send = 0;                        ///< when that began
};

/// All connections. Each is parked, with nobody at work on it, or taken by one thread; `take` and
/// `park` hand it on. Thread safe.
class Clients {
 public:
  using Watch = std::function<void(const Client&)>;
  /// `watch` is called for every client that is parked, so that somebody takes it when its socket
  /// is ready; in the lock, because from then on another thread may close it.
  explicit Clients(Watch watch) : watch_(std::move(watch)) {}

  /// A client that is parked and idle.
  void add(std::unique_ptr<Client> client);
  std::size_t size() const;

  /// The client at a socket, which belongs to the caller now. Null where there is none (any more)
  /// or another thread has it; who has it will watch it again.
  Client* take(int socket);
  void park(Client& client, Phase phase);
  /// In the phase in which it was, whose time goes on.
  void park_again(Client& client);
  /// Closes a client that the caller has.
  void remove(Client& client);

  /// Takes the parked ones for which it is so.
  std::vector<Client*> take_if(const std::function<bool(const Client&)>& condition);
  /// Closes the one that has been idle for longest. False where none is.
  bool remove_longest_idle();
  /// Closes the parked ones for which it is so.
  void remove_if(const std::function<bool(const Client&)>& condition);
  /// True while one is taken, or parked with an answer that its peer has not read.
  bool is_any_answered() const;

 private:
  const Watch watch_;
  mutable std::mutex mutex_;  ///< of the clients, and of what is parked in them
  std::unordered_map<int, std::unique_ptr<Client>> clients_;
};

}  // namespace cellmap::server
