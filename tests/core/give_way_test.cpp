#include "cellmap/core/give_way.hpp"

#include <gtest/gtest.h>
#include <sched.h>
#include <sys/resource.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace cellmap {
namespace {

/// How often a thread handed its processor over in 60 ms of its work, which it did beside another
/// one that always wants it too.
long times_others_ran(const GiveWay& give_way) {
  cpu_set_t one;
  CPU_ZERO(&one);
  CPU_SET(sched_getcpu(), &one);
  const auto stay = [&] { return sched_setaffinity(0, sizeof(one), &one) == 0; };
  std::atomic<bool> ready = false, done = false;
  std::thread other([&] {
    stay();
    ready = true;
    while (!done) {
    }
  });
  long times = 0;
  std::thread worker([&] {
    stay();
    while (!ready) std::this_thread::yield();
    const auto used = [] {
      rusage usage{};
      getrusage(RUSAGE_THREAD, &usage);
      return usage;
    };
    const rusage before = used();
    const auto us = [](const rusage& u) {
      return (u.ru_utime.tv_sec + u.ru_stime.tv_sec) * 1'000'000 + u.ru_utime.tv_usec +
             u.ru_stime.tv_usec;
    };
    while (us(used()) - us(before) < 60'000) give_way();
    const rusage after = used();
    times = after.ru_nvcsw + after.ru_nivcsw - before.ru_nvcsw - before.ru_nivcsw;
  });
  worker.join();
  done = true;
  other.join();
  return times;
}

TEST(GiveWay, NothingHappensWhereNoneWasGiven) { EXPECT_NO_THROW(GiveWay()()); }

TEST(GiveWay, OthersHaveTheProcessorInBetweenInsteadOfAfterATick) {
  TimedYield yield(std::chrono::microseconds(250));
  const long by_ticks = times_others_ran(GiveWay());
  const long by_yielding = times_others_ran(GiveWay([&] { yield(); }));
  EXPECT_GT(by_yielding, 2 * by_ticks);
}

}  // namespace
}  // namespace cellmap
