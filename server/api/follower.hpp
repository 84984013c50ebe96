#pragma once

#include "server/api/api.hpp"

namespace cellmap::server {

/// One client that waits for something to happen: an event stream or a long poll. At most
/// `ApiOptions::max_followers` at a time, because each holds a connection and its thread.
class Follower {
 public:
  /// Throws Error{kUnavailable} where there are too many.
  explicit Follower(Services& services);
  ~Follower();
  Follower(const Follower&) = delete;
  Follower& operator=(const Follower&) = delete;

 private:
  Services& services_;
};

/// A stream says something at most so often; what happens between is told at once.
constexpr std::chrono::milliseconds kShortestEventInterval(100);

}  // namespace cellmap::server
