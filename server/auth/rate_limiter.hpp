#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>
#include <unordered_map>

namespace cellmap::auth {

/// Token buckets by key: each holds two seconds' worth of requests, at least one, and fills at its
/// rate. Thread safe; O(1), memory for `max_keys` at most.
class RateLimiter {
 public:
  using Clock = std::chrono::steady_clock;

  explicit RateLimiter(std::size_t max_keys = 10'000) : max_keys_(max_keys) {}

  /// Takes one request of `key`, whose rate is above 0. Zero: it may go on; else how long it has to
  /// wait until one may.
  std::chrono::duration<double> take(const std::string& key, double per_second,
                                     Clock::time_point now);

 private:
  struct Bucket {
    double level;
    double per_second;
    Clock::time_point filled;
  };
  void forget_full_ones(Clock::time_point now);

  const std::size_t max_keys_;
  std::mutex mutex_;
  std::unordered_map<std::string, Bucket> buckets_;
};

}  // namespace cellmap::auth
