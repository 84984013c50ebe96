#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace cellmap {

/// Counts changes and wakes those that wait for the next one. Thread safe.
///
///   const auto seen = signal.count();      // before looking, so that no change is missed
///   if (!is_there_what_i_want()) signal.wait(seen, timeout);
class CommitSignal {
 public:
  std::uint64_t count() const {
    const std::lock_guard lock(mutex_);
    return count_;
  }

  /// Wakes all that wait; also for another reason than a change, which they then find out.
  void notify() {
    const std::lock_guard lock(mutex_);
    ++count_;
    changed_.notify_all();
  }

  /// Returns the count as soon as it differs from `seen`, or when time is up.
  std::uint64_t wait(std::uint64_t seen, std::chrono::milliseconds timeout) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, timeout, [&] { return count_ != seen; });
    return count_;
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t count_ = 0;
};

}  // namespace cellmap
