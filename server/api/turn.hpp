#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <semaphore>

#include "cellmap/core/parallel.hpp"

namespace cellmap::server {

struct Services;

/// Of what takes a processor for long a few run at a time, and some more wait for their turn.
struct Turns {
  const char* what;  ///< in messages
  const int at_a_time;
  const std::chrono::milliseconds wait;
  std::counting_semaphore<> free{at_a_time};
  std::atomic<int> taken = 0;  ///< of those that run or wait
};

/// Runs `work` in its turn, in the background, so that requests that take a millisecond are
/// answered beside it. Throws Error{kUnavailable} at once where many wait already, and where its
/// turn does not come in time, and what `work` throws. It has `threads` where it is alone, else
/// one: together they keep the processors busy anyway.
void in_turn(Turns& turns, int threads, const std::function<void(const Effort&)>& work);

/// The same as one of the relocalisations and comparisons, with as many threads as the options say.
void in_turn(Services& services, const std::function<void(const Effort&)>& work);

}  // namespace cellmap::server
