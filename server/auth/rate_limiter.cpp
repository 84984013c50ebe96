#include "server/auth/rate_limiter.hpp"

#include <algorithm>

namespace cellmap::auth {
namespace {

constexpr double kBurst_s = 2;

double capacity(double per_second) { return std::max(1.0, kBurst_s * per_second); }

double filled_level(double level, double per_second, std::chrono::duration<double> since) {
  return std::min(capacity(per_second), level + per_second * since.count());
}

}  // namespace

std::chrono::duration<double> RateLimiter::take(const std::string& key, double per_second,
                                                Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (buckets_.size() >= max_keys_ && !buckets_.contains(key)) forget_full_ones(now);
  auto& bucket =
      buckets_.try_emplace(key, Bucket{capacity(per_second), per_second, now}).first->second;
  bucket.level = filled_level(bucket.level, per_second, now - bucket.filled);
  bucket.per_second = per_second;
  bucket.filled = now;
  if (bucket.level < 1) return std::chrono::duration<double>((1 - bucket.level) / per_second);
  bucket.level -= 1;
  return {};
}

/// A full bucket says nothing. Where none is full, all begin anew: memory matters more.
void RateLimiter::forget_full_ones(Clock::time_point now) {
  std::erase_if(buckets_, [&](const auto& entry) {
    const Bucket& bucket = entry.second;
    return filled_level(bucket.level, bucket.per_second, now - bucket.filled) >=
           capacity(bucket.per_second);
  });
  if (buckets_.size() >= max_keys_) buckets_.clear();
}

}  // namespace cellmap::auth
