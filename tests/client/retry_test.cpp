#include "cellmap/client/retry.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using std::chrono::milliseconds;

RetryOptions seeded(int attempts) {
  RetryOptions options;
  options.attempts = attempts;
  options.jitter_seed = 7;
  return options;
}

TEST(RetrySchedule, DelaysDoubleUpToTheirLimitWithJitterBelow) {
  RetrySchedule schedule(seeded(20));
  milliseconds nominal{100};
  for (int failure = 1; failure < 20; ++failure) {
    const auto delay = schedule.next_delay({});
    ASSERT_TRUE(delay);
    EXPECT_GE(*delay, nominal / 2) << failure;
    EXPECT_LE(*delay, nominal) << failure;
    nominal = std::min(nominal * 2, milliseconds(5000));
  }
}

TEST(RetrySchedule, EndsWithTheLastAttempt) {
  RetrySchedule schedule(seeded(3));
  EXPECT_TRUE(schedule.next_delay({}));
  EXPECT_TRUE(schedule.next_delay({}));
  EXPECT_FALSE(schedule.next_delay({}));
}

TEST(RetrySchedule, NeverWaitsLessThanTheServerAsked) {
  RetrySchedule schedule(seeded(3));
  EXPECT_EQ(schedule.next_delay(milliseconds(9000)), milliseconds(9000));
}

TEST(RetrySchedule, GivesUpWhereTheServerAsksForTooLong) {
  RetrySchedule schedule(seeded(10));
  EXPECT_FALSE(schedule.next_delay(milliseconds(60'001)));
}

TEST(RetrySchedule, ClientsWithDifferentSeedsDoNotWaitInStep) {
  RetryOptions other = seeded(20);
  other.jitter_seed = 8;
  RetrySchedule a(seeded(20)), b(other);
  int different = 0;
  for (int i = 0; i < 10; ++i) different += a.next_delay({}) != b.next_delay({});
  EXPECT_GE(different, 5);
}

TEST(RetryAfter, IsReadInSecondsOnly) {
  EXPECT_EQ(parse_retry_after("3"), milliseconds(3000));
  EXPECT_EQ(parse_retry_after("0"), milliseconds(0));
  for (const char* other : {"", "-1", "3s", "1e9", "Wed, 21 Oct 2026 07:28:00 GMT", "86401"}) {
    EXPECT_FALSE(parse_retry_after(other)) << other;
  }
}

TEST(RetryOptions, OutOfRangeIsRefused) {
  RetryOptions options;
  options.attempts = 0;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { options.validate(); }, "attempts");
  RetryOptions reversed;
  reversed.max_delay = milliseconds(1);
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { reversed.validate(); }, "first_delay");
}

}  // namespace
}  // namespace cellmap
