#include "cellmap/core/error.hpp"

#include <gtest/gtest.h>

#include <set>

namespace cellmap {
namespace {

constexpr int kCodeCount = static_cast<int>(ErrorCode::kDiskFull) + 1;

TEST(ErrorCodes, EveryNameIsReadBackAsItsCode) {
  for (int i = 0; i < kCodeCount; ++i) {
    const auto code = static_cast<ErrorCode>(i);
    EXPECT_EQ(error_code_from_string(to_string(code)), code) << to_string(code);
  }
}

TEST(ErrorCodes, NoTwoCodesShareAName) {
  std::set<std::string_view> names;
  for (int i = 0; i < kCodeCount; ++i) names.insert(to_string(static_cast<ErrorCode>(i)));
  EXPECT_EQ(names.size(), static_cast<std::size_t>(kCodeCount));
}

TEST(ErrorCodes, AnUnknownNameIsAnInternalFault) {
  EXPECT_EQ(error_code_from_string("teapot"), ErrorCode::kInternal);
  EXPECT_EQ(error_code_from_string(""), ErrorCode::kInternal);
  EXPECT_EQ(error_code_from_string("Not-Found"), ErrorCode::kInternal);
}

TEST(Errors, CarryTheirCodeAndTheirWholeMessage) {
  const Error error(ErrorCode::kTooLarge, "expected at most 3, found 4");
  EXPECT_EQ(error.code(), ErrorCode::kTooLarge);
  EXPECT_STREQ(error.what(), "expected at most 3, found 4");
}

}  // namespace
}  // namespace cellmap
