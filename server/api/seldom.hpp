#pragma once

#include <atomic>
#include <chrono>

namespace cellmap::server {

/// True at first and then at most once a minute: for what would fill a log. Thread safe.
class Seldom {
 public:
  bool operator()() {
    const auto now = std::chrono::steady_clock::now().time_since_epoch().count();
    auto next = next_.load();
    return now >= next && next_.compare_exchange_strong(next, now + kPause.count());
  }

 private:
  static constexpr std::chrono::nanoseconds kPause = std::chrono::minutes(1);
  std::atomic<std::chrono::steady_clock::rep> next_ = 0;
};

}  // namespace cellmap::server
