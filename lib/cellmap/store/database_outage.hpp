#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>

namespace cellmap {

/// What the connections of one store tell each other about their database: once one of them found
/// it away, the others do not find out by waiting too. Thread safe.
class DatabaseOutage {
 public:
  /// Why nobody should try again yet, as the last one who tried was told; empty when it is time.
  std::string reason() const {
    const std::lock_guard lock(mutex_);
    return Clock::now() < again_ ? reason_ : std::string();
  }
  void report(const std::string& reason) {
    const std::lock_guard lock(mutex_);
    reason_ = reason;
    again_ = Clock::now() + kPause;
    ++count_;
  }
  /// Grows with every report: who was connected before is to connect anew.
  std::uint64_t count() const {
    const std::lock_guard lock(mutex_);
    return count_;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kPause{1};

  mutable std::mutex mutex_;
  std::string reason_;
  Clock::time_point again_;
  std::uint64_t count_ = 0;
};

}  // namespace cellmap
