#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <random>
#include <string_view>

#include "cellmap/core/error.hpp"

namespace cellmap {

/// When a failed request is sent again.
///
/// Sent again are: any request that the server refused unprocessed (503, 429) or that never reached
/// it (connection refused); and idempotent ones (GET, HEAD, PUT, DELETE and the POSTs that only
/// read or that name a session) also where the connection broke half-way or a gateway failed
/// (502, 504).
struct RetryOptions {
  int attempts = 5;                            ///< tries in all, 1 to 100; 1: never again
  std::chrono::milliseconds first_delay{100};  ///< doubles with every failure ...
  std::chrono::milliseconds max_delay{5'000};  ///< ... up to this
  /// A server's Retry-After is waited out in full where it is at most this; a longer one ends the
  /// attempts and becomes the caller's Error{kUnavailable} or {kRateLimited}.
  std::chrono::milliseconds max_retry_after{60'000};
  std::uint64_t jitter_seed = 0;  ///< 0: from the operating system; equal seeds wait equally
  /// How to wait; empty: sleep. Tests put a recorder here.
  std::function<void(std::chrono::milliseconds)> sleep;

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// Whether the same may work later: the server is away, busy or without room, or the network is.
bool may_pass(ErrorCode code);

/// Exponential backoff with jitter, and the server's word where it gave one. One owner.
class RetrySchedule {
 public:
  explicit RetrySchedule(const RetryOptions& options);

  /// How long to wait before the next try; nullopt where there is to be none. Without `retry_after`
  /// the delay is drawn evenly from [d/2, d], d = first_delay * 2^failures, at most max_delay; with
  /// it never less than what the server asked for.
  std::optional<std::chrono::milliseconds> next_delay(
      std::optional<std::chrono::milliseconds> retry_after);

  /// Waits as the options say.
  void sleep(std::chrono::milliseconds delay) const;

  int failures() const { return failures_; }

 private:
  RetryOptions options_;
  std::mt19937_64 random_;
  int failures_ = 0;
};

/// A Retry-After header in seconds ("3") as milliseconds; nullopt for anything else (dates
/// included: clocks differ) and above a day.
std::optional<std::chrono::milliseconds> parse_retry_after(std::string_view header);

}  // namespace cellmap
