#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <vector>

namespace cellmap {

/// Lets threads that write at the same time share one transaction, because making a transaction
/// durable costs the same for one write and for fifty. No thread of its own: the caller at the head
/// of the queue carries out the work of all that wait behind it.
class GroupCommit {
 public:
  /// One caller's write. `failure` is set where it, or the transaction that held it, failed.
  struct Write {
    std::function<void()> work;
    std::exception_ptr failure;
    bool done = false;
  };

  /// Carries out a batch in one transaction and sets the failures. Must not throw.
  using Execute = std::function<void(const std::vector<Write*>& batch)>;

  GroupCommit(Execute execute, std::chrono::milliseconds max_wait, std::size_t max_batch)
      : execute_(std::move(execute)), max_wait_(max_wait), max_batch_(max_batch) {}

  /// Returns once `work` is durable; throws what it or its transaction threw. `work` may run in
  /// another caller's thread while this one waits. Thread safe; writes are carried out in the order
  /// of arrival.
  void run(std::function<void()> work);

  /// Writes that have begun and not ended.
  std::size_t waiting();

 private:
  std::vector<Write*> next_batch(std::unique_lock<std::mutex>& lock);

  const Execute execute_;
  const std::chrono::milliseconds max_wait_;
  const std::size_t max_batch_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Write*> queue_;
  std::size_t writers_ = 1;  ///< that took part in or waited for the last batch
};

}  // namespace cellmap
