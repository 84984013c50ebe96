#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <utility>

namespace cellmap {

/// Lets others have the processor in between where they wait for it. The scheduler by itself lets
/// a thread go on until a tick, 4 ms at 250 Hz, for which whoever answers in less than one would
/// have to wait. Who yields to another one loses the rest of its time slice (Linux 6.18: 3 ms), so
/// the more often, the smaller its share. Thread safe; threads that share one take turns.
class TimedYield {
 public:
  explicit TimedYield(std::chrono::microseconds period) : period_(period) {}
  /// To be called more often than once a period: mostly it only looks at the clock, 30 ns.
  void operator()();

 private:
  const std::chrono::steady_clock::duration period_;
  std::atomic<std::chrono::steady_clock::duration> last_{};
};

/// What a long computation calls between pieces of work of some tenths of a millisecond, from the
/// thread that does them. Nothing happens where none was given. As thread safe as what was given.
class GiveWay {
 public:
  GiveWay() = default;
  explicit GiveWay(std::function<void()> call) : call_(std::move(call)) {}
  void operator()() const {
    if (call_) call_();
  }

 private:
  std::function<void()> call_;
};

}  // namespace cellmap
