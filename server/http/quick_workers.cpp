#include "server/http/quick_workers.hpp"

#include <algorithm>
#include <array>
#include <span>
#include <utility>

#include "cellmap/core/give_way.hpp"

namespace cellmap::server {
namespace {

/// Workers that come to share a processor, because something computes on the other one, would wait
/// for each other's ticks: fetches while relocalisation is saturated then take 5.5 ms instead of 2
/// (p99). With a quarter of this, clients on the same machine get so much that a mixed fleet's p99
/// is 17 ms instead of 12.
constexpr std::chrono::milliseconds kTurn(1);

}  // namespace

QuickWorkers::QuickWorkers(std::size_t threads, std::size_t at_once, std::size_t max_waiting,
                           OnReady on_ready)
    : thread_count_(threads),
      at_once_(std::clamp<std::size_t>(at_once, 1, kMostAtOnce)),
      max_waiting_(max_waiting),
      on_ready_(std::move(on_ready)) {
  poll_.watch(waiting_bell_.descriptor());
  poll_.watch(end_bell_.descriptor());
}

void QuickWorkers::start() {
  for (std::size_t i = 0; i < thread_count_; ++i) threads_.emplace_back([this] { work(); });
}

bool QuickWorkers::put(Work work) {
  {
    const std::lock_guard lock(mutex_);
    if (waiting_.size() >= max_waiting_) return false;
    waiting_.push_back(std::move(work));
  }
  waiting_bell_.ring();
  return true;
}

bool QuickWorkers::work_from_queue() {
  Work work;
  {
    const std::lock_guard lock(mutex_);
    if (waiting_.empty()) return false;
    work = std::move(waiting_.front());
    waiting_.pop_front();
  }
  work();
  return true;
}

std::vector<int> QuickWorkers::take_ready() const {
  std::vector<int> sockets;
  std::array<epoll_event, 128> events;
  for (std::size_t before = 0;; before = sockets.size()) {
    for (const epoll_event& event : poll_.wait(events, std::chrono::milliseconds(0))) {
      const int socket = event.data.fd;
      const bool is_bell = socket == waiting_bell_.descriptor() || socket == end_bell_.descriptor();
      if (!is_bell) sockets.push_back(socket);
    }
    if (sockets.size() == before) return sockets;
  }
}

void QuickWorkers::finish() {
  end_bell_.ring();  // and nobody hears it, so that all wake
  for (std::thread& thread : threads_) thread.join();
  threads_.clear();
}

bool QuickWorkers::handle(int socket) {
  if (socket == end_bell_.descriptor()) return false;
  if (socket != waiting_bell_.descriptor()) {
    on_ready_(socket);
  } else if (waiting_bell_.hear()) {
    work_from_queue();
  }
  return true;
}

void QuickWorkers::work() {
  std::array<epoll_event, kMostAtOnce> events;
  TimedYield yield(kTurn);
  for (bool is_end = false; !is_end;) {
    yield();
    ++idle_;
    const auto ready = poll_.wait(std::span(events).first(at_once_), std::chrono::milliseconds(-1));
    --idle_;
    for (const epoll_event& event : ready) is_end |= !handle(event.data.fd);
  }
  while (work_from_queue()) {
  }
}

}  // namespace cellmap::server
