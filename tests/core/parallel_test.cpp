#include "cellmap/core/parallel.hpp"

#include <gmock/gmock.h>

#include <atomic>
#include <mutex>
#include <numeric>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

namespace cellmap {
namespace {

using Bounds = std::set<std::pair<std::size_t, std::size_t>>;

Bounds bounds_of(std::size_t count, std::size_t grain, int threads) {
  Bounds bounds;
  std::mutex mutex;
  parallel_for(count, grain, threads, [&](std::size_t begin, std::size_t end) {
    const std::lock_guard lock(mutex);
    EXPECT_TRUE(bounds.emplace(begin, end).second) << begin << " was visited twice";
  });
  return bounds;
}

TEST(ParallelFor, CoversTheRangeOnceInPiecesOfTheGrain) {
  for (const std::size_t count : {1u, 7u, 8u, 9u, 1000u}) {
    std::size_t next = 0;
    for (const auto& [begin, end] : bounds_of(count, 8, 2)) {
      EXPECT_EQ(begin, next);
      EXPECT_EQ(end, std::min<std::size_t>(count, begin + 8));
      next = end;
    }
    EXPECT_EQ(next, count);
  }
}

TEST(ParallelFor, GivesWayAfterEveryPiece) {
  for (const int threads : {1, 2}) {
    std::atomic<int> pieces = 0, times = 0;
    const Effort effort(threads, GiveWay([&] { ++times; }));
    parallel_for(35, 10, effort, [&](std::size_t, std::size_t) { ++pieces; });
    EXPECT_EQ(times, 4);
    EXPECT_EQ(pieces, 4);
  }
}

TEST(ParallelFor, CallsNothingForAnEmptyRange) { EXPECT_TRUE(bounds_of(0, 8, 2).empty()); }

TEST(ParallelFor, TakesAGrainOfZeroForOne) {
  EXPECT_EQ(bounds_of(3, 0, 2), (Bounds{{0, 1}, {1, 2}, {2, 3}}));
}

TEST(ParallelFor, CutsTheRangeAlikeForAnyThreadCount) {
  const Bounds serial = bounds_of(1003, 10, 1);
  for (const int threads : {0, 2, 3, 64}) EXPECT_EQ(bounds_of(1003, 10, threads), serial);
}

/// Sums that depend on the order of additions, a partial sum a piece.
std::vector<float> partial_sums(int threads) {
  std::vector<float> sums(100);
  parallel_for(10'000, 100, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      sums[begin / 100] += 1.0f / static_cast<float>(i + 1);
    }
  });
  return sums;
}

TEST(ParallelFor, GivesTheSameBitsForAnyThreadCount) {
  EXPECT_EQ(partial_sums(1), partial_sums(2));
  EXPECT_EQ(partial_sums(1), partial_sums(0));
}

TEST(ParallelFor, RethrowsWhatABodyThrew) {
  for (const int threads : {1, 2}) {
    EXPECT_THROW(parallel_for(100, 1, threads,
                              [](std::size_t begin, std::size_t) {
                                if (begin == 57) throw std::out_of_range("57");
                              }),
                 std::out_of_range);
  }
}

TEST(ParallelFor, MayBeCalledFromABody) {
  std::vector<int> visits(64, 0);
  parallel_for(8, 1, 2, [&](std::size_t row, std::size_t) {
    parallel_for(8, 1, 2, [&](std::size_t column, std::size_t) { ++visits[8 * row + column]; });
  });
  EXPECT_THAT(visits, ::testing::Each(1));
}

TEST(ParallelFor, AsksForNoMoreThreadsThanTheMachineHas) {
  testing::internal::CaptureStderr();
  bounds_of(1000, 1, 1024);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace cellmap
