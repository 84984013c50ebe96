#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <exception>
#include <functional>
#include <memory>
#include <vector>

#include "server/http/connection.hpp"
#include "server/http/listener.hpp"
#include "server/http/request_head.hpp"

namespace cellmap::server {

struct FrontOptions {
  std::size_t max_connections = 4096;  ///< held open; beyond them the longest idle one makes room
  /// For answers that only take processor and disk; 0: one a processor and at least two, more would
  /// only stand in each other's way. Where such answers wait too: eight a processor.
  std::size_t quick_workers = 0;
  /// Quick answers wait for a database elsewhere. Then no worker takes more than one request.
  bool waits_for_database = false;
  std::size_t patient_workers = 256;  ///< for those that wait: for bodies, jobs, followers, turns
  std::size_t max_waiting = 256;      ///< requests before each; more get 503 with Retry-After
  HeadLimits head;
  std::chrono::milliseconds head_timeout{10'000};  ///< for a whole head once it has begun
  std::chrono::milliseconds idle_timeout{30'000};  ///< of a kept connection
  std::chrono::milliseconds stop_timeout{10'000};  ///< for what is being answered when it stops
  ConnectionLimits connection;
};

/// What the front does not know: HTTP beyond heads.
struct FrontHandlers {
  /// Whether a request may wait for something else than the processor and the disk.
  std::function<bool(const RequestHead&)> may_wait;
  /// Reads and answers the request whose head the connection's input begins with. Called by a
  /// worker. False where the connection has to end after the answer.
  std::function<bool(Connection&, const RequestHead&)> serve;
  /// Told what `serve` threw, for example because a file could not be read while it was sent. The
  /// connection is closed, so that a cut off answer cannot be taken for a whole one.
  std::function<void(const std::exception&)> on_failure;
  /// Adds to the front's own answers what every answer has. May be empty.
  std::function<void(Response&)> complete = {};
};

/// The sockets of the server. One thread, the loop, accepts, reads heads that come in pieces and
/// sends what slow readers have not taken yet, all without waiting (epoll); so thousands of idle or
/// slow clients cost a few kilobytes each and nobody's time. Idle connections are waited for by the
/// quick workers themselves (`QuickWorkers`): whom the kernel wakes reads the head, answers, and
/// parks the connection again, so that a fetch costs no other thread anything. Heads have to be
/// whole and in order (`read_request_head`) before anything is done for them. What may wait (for a
/// body, for a job's events, for a relocalisation's turn) goes to the patient workers, so that it
/// never holds up a fetch. When all quick workers are at work the loop looks at what came, within a
/// tenth of a second, and puts it into their queue; where a queue is full a request is refused
/// before it costs anything.
///
///     accepted -> idle -> (head) -> served by a worker -> (sending) -> idle ...
///                                                      -> closing: half closed, until the peer
///                                                         has read the answer
///
/// A connection belongs to the thread that took it, until that parks it (`Clients`). A process with
/// a front ignores SIGPIPE.
class Front {
 public:
  Front(std::vector<Listener> listeners, FrontOptions options, FrontHandlers handlers);
  ~Front();

  /// Serves until `stop`: then takes no more connections, closes idle ones, lets workers finish.
  void run();
  /// Any thread, once `run` was called or before.
  void stop();
  bool is_stopping() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap::server
