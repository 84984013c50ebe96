#pragma once

#include <atomic>
#include <cstddef>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <thread>
#include <vector>

#include "server/http/poll.hpp"

namespace cellmap::server {

/// Threads that wait for sockets themselves: the kernel wakes the one that slept last, and it
/// reads, answers and waits again, so that no thread ever wakes another one for a request. Beside
/// the sockets they take work out of a bounded queue. Thread safe.
class QuickWorkers {
 public:
  using Work = std::function<void()>;
  /// Called by a worker for a socket that is ready; it is not watched any more.
  using OnReady = std::function<void(int socket)>;

  /// A thread takes up to `at_once` sockets, 1 to kMostAtOnce, one after the other: whoever waits
  /// behind another one in it cannot be taken by an idle thread.
  QuickWorkers(std::size_t threads, std::size_t at_once, std::size_t max_waiting, OnReady on_ready);
  ~QuickWorkers() { finish(); }

  /// Once, before anything is answered.
  void start();
  /// `on_ready` is called for it once, as soon as it can be read.
  void watch(int socket) const { poll_.watch_once(socket, EPOLLIN); }
  /// False where the queue is full.
  bool put(Work work);
  /// True while a thread waits for something to do.
  bool has_idle() const { return idle_ > 0; }
  /// The sockets that are ready and that nobody takes, because all are at work. They are not
  /// watched any more.
  std::vector<int> take_ready() const;
  /// Ends when all that was put is done. Nothing may be put any more.
  void finish();

 private:
  static constexpr std::size_t kMostAtOnce = 2;

  void work();
  /// What an event of the poll says. False at the end.
  bool handle(int socket);
  bool work_from_queue();

  const std::size_t thread_count_, at_once_, max_waiting_;
  const OnReady on_ready_;
  const Poll poll_;
  const Bell waiting_bell_{true}, end_bell_{false};
  std::atomic<std::size_t> idle_ = 0;
  std::mutex mutex_;  ///< of `waiting_`
  std::deque<Work> waiting_;
  std::list<std::thread> threads_;
};

}  // namespace cellmap::server
