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
  std::size_t quick_workers = 8;       ///< for answers that only take processor and disk
  std::size_t patient_workers = 256;   ///< for those that wait: for bodies, jobs, followers, turns
  std::size_t max_waiting = 256;       ///< requests before each; more get 503 with Retry-After
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

/// The sockets of the server. One thread accepts, holds idle connections, reads heads and sends
/// what slow readers have not taken yet, all without waiting (epoll); so thousands of idle or slow
/// clients cost a few kilobytes each and nobody's time. A worker gets a connection only with a
/// request whose head is whole and in order (`read_request_head`). There are two kinds, so that
/// those who wait (for a body, for a job's events, for a relocalisation's turn) never hold up a
/// fetch. When both workers and their queue are taken a request is refused before it costs
/// anything.
///
///     accepted -> idle -> head -> served by a worker -> (sending) -> idle ...
///                                                    -> closing: half closed, until the peer has
///                                                       read the answer
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
