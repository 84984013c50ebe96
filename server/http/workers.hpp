#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <list>
#include <mutex>
#include <thread>

namespace cellmap::server {

/// Threads that grow with the work up to a limit, and a bounded queue before them. Thread safe.
class Workers {
 public:
  using Work = std::function<void()>;

  Workers(std::size_t max_threads, std::size_t max_waiting)
      : max_threads_(max_threads), max_waiting_(max_waiting) {}
  ~Workers() { finish(); }

  /// False where the queue is full.
  bool put(Work work);
  /// Ends when all that was put is done. Nothing may be put any more.
  void finish();

 private:
  void work();

  const std::size_t max_threads_, max_waiting_;
  std::mutex mutex_;
  std::condition_variable ready_;
  std::deque<Work> waiting_;
  std::list<std::thread> threads_;
  std::size_t idle_ = 0;
  bool ending_ = false;
};

}  // namespace cellmap::server
