#include "server/api/failure.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cellmap/core/error.hpp"
#include "server/api/problem.hpp"

namespace cellmap::server {
namespace {

using testing::HasSubstr;
using testing::Not;

Response problem_of(ErrorCode code) {
  return server::problem_of(std::make_exception_ptr(Error(code, "/var/lib/secret.db broke")), "r1");
}

TEST(Failures, AFullDiskHasACodeAndAStatusOfItsOwn) {
  const Response response = problem_of(ErrorCode::kDiskFull);
  EXPECT_EQ(response.status, 507);
  EXPECT_EQ(problem_code(response), "disk-full");
}

TEST(Failures, WhatFailsAtTheServerNamesNoFileOfIt) {
  for (const ErrorCode code : {ErrorCode::kDiskFull, ErrorCode::kIo, ErrorCode::kInternal}) {
    EXPECT_THAT(std::string(body_view(problem_of(code))), Not(HasSubstr("secret")))
        << to_string(code);
  }
}

TEST(Failures, EveryCodeHasAStatusThatSaysWhoseFaultItIs) {
  for (int i = 0; i <= static_cast<int>(ErrorCode::kDiskFull); ++i) {
    const auto code = static_cast<ErrorCode>(i);
    const bool ours =
        is_io(code) || code == ErrorCode::kInternal || code == ErrorCode::kUnavailable;
    EXPECT_EQ(status_of(code) >= 500, ours) << to_string(code);
  }
}

}  // namespace
}  // namespace cellmap::server
