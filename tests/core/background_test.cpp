#include "cellmap/core/background.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>

#include "cellmap/core/error.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

int niceness() { return getpriority(PRIO_PROCESS, 0); }

TEST(Background, WorkYieldsAndItsCallerDoesNot) {
  const int before = niceness();
  int inside = before;
  run_in_background([&](const GiveWay&) { inside = niceness(); });
  EXPECT_GE(inside, std::min(before + 1, 19));
  EXPECT_EQ(niceness(), before);
}

TEST(Background, WhatWorkThrowsReachesItsCaller) {
  test::expect_error(ErrorCode::kConflict, [] {
    run_in_background([](const GiveWay&) { throw Error(ErrorCode::kConflict, "no"); });
  });
}

}  // namespace
}  // namespace cellmap
