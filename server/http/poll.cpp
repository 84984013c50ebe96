#include "server/http/poll.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace cellmap::server {

Poll::Poll() : epoll_(::epoll_create1(EPOLL_CLOEXEC)) {}

void Poll::set(int socket, std::uint32_t events) const {
  epoll_event event{};
  event.events = events;
  event.data.fd = socket;
  // Nearly always it is known already.
  if (::epoll_ctl(epoll_.value(), EPOLL_CTL_MOD, socket, &event) != 0 && errno == ENOENT) {
    ::epoll_ctl(epoll_.value(), EPOLL_CTL_ADD, socket, &event);
  }
}

std::span<const epoll_event> Poll::wait(std::span<epoll_event> events,
                                        std::chrono::milliseconds time) const {
  const int ready = ::epoll_wait(epoll_.value(), events.data(), static_cast<int>(events.size()),
                                 static_cast<int>(time.count()));
  return events.first(static_cast<std::size_t>(std::max(ready, 0)));
}

Bell::Bell(bool counts)
    : event_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC | (counts ? EFD_SEMAPHORE : 0))) {}

void Bell::ring() const {
  const std::uint64_t one = 1;
  [[maybe_unused]] const auto written = ::write(event_.value(), &one, sizeof(one));
}

bool Bell::hear() const {
  std::uint64_t count;
  return ::read(event_.value(), &count, sizeof(count)) > 0;
}

}  // namespace cellmap::server
