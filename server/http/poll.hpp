#pragma once

#include <sys/epoll.h>

#include <chrono>
#include <cstdint>
#include <span>

#include "server/http/descriptor.hpp"

namespace cellmap::server {

/// Sockets that threads wait for (epoll). Thread safe; a socket that is closed is forgotten.
class Poll {
 public:
  Poll();

  /// Whenever there is something to read, for every thread that waits.
  void watch(int socket) const { set(socket, EPOLLIN); }
  /// The next time only, and for one thread only: EPOLLIN or EPOLLOUT. At once where it is ready.
  void watch_once(int socket, std::uint32_t direction) const {
    set(socket, direction | EPOLLONESHOT);
  }
  void ignore(int socket) const { set(socket, 0); }

  /// The first of `events`, as many as are ready; a negative time waits for ever.
  std::span<const epoll_event> wait(std::span<epoll_event> events,
                                    std::chrono::milliseconds time) const;

 private:
  void set(int socket, std::uint32_t events) const;

  const Descriptor epoll_;
};

/// Wakes a `Poll` that watches it.
class Bell {
 public:
  /// `counts`: each `ring` is heard once; else one `hear` takes all of them.
  explicit Bell(bool counts);

  int descriptor() const { return event_.value(); }
  void ring() const;
  /// False where nobody has rung, or another thread heard it.
  bool hear() const;

 private:
  const Descriptor event_;
};

}  // namespace cellmap::server
