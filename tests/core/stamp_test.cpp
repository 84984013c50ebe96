#include "cellmap/core/stamp.hpp"

#include <gtest/gtest.h>

namespace cellmap {
namespace {

TEST(Stamps, RoundToTheNearestNanosecondOnBothSidesOfZero) {
  EXPECT_EQ(stamp_from_seconds(0), 0);
  EXPECT_EQ(stamp_from_seconds(1.4e-9), 1);
  EXPECT_EQ(stamp_from_seconds(1.6e-9), 2);
  EXPECT_EQ(stamp_from_seconds(-1.4e-9), -1);
  EXPECT_EQ(stamp_from_seconds(-1.6e-9), -2);
}

TEST(Stamps, KeepDecimalSecondsThatBinaryFractionsMiss) {
  // As a double 127,127e-9 s is a little less: cut off instead of rounded, it loses a nanosecond.
  EXPECT_EQ(stamp_from_seconds(127'127e-9), 127'127);
  EXPECT_EQ(stamp_from_seconds(-127'127e-9), -127'127);
}

TEST(Stamps, OfWholeMillisecondsOfADriveAreReadBack) {
  for (Stamp milliseconds = -100'000; milliseconds <= 100'000; milliseconds += 103) {
    const Stamp stamp = milliseconds * 1'000'000;
    EXPECT_EQ(stamp_from_seconds(to_seconds(stamp)), stamp);
  }
}

}  // namespace
}  // namespace cellmap
