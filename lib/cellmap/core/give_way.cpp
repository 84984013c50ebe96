#include "cellmap/core/give_way.hpp"

#include <thread>

namespace cellmap {
namespace {

std::chrono::steady_clock::duration now() {
  return std::chrono::steady_clock::now().time_since_epoch();
}

}  // namespace

void TimedYield::operator()() {
  if (now() - last_.load(std::memory_order_relaxed) < period_) return;
  std::this_thread::yield();
  last_.store(now(), std::memory_order_relaxed);
}

}  // namespace cellmap
