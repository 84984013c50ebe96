#include "server/api/conditions.hpp"

#include <gtest/gtest.h>

#include <array>

namespace cellmap::server {
namespace {

const std::array<std::string, 2> kTags{"\"a\"", "\"b\""};

TEST(Conditions, AnEntityTagMatchesInAListWeaklyOrByStar) {
  EXPECT_TRUE(matches_etag("\"a\"", kTags));
  EXPECT_TRUE(matches_etag("\"x\", W/\"b\"", kTags));
  EXPECT_TRUE(matches_etag("*", kTags));
  EXPECT_FALSE(matches_etag("\"x\"", kTags));
  EXPECT_FALSE(matches_etag("a", kTags));
  EXPECT_FALSE(matches_etag("", kTags));
}

TEST(Conditions, OneRangeIsTakenFromTheFrontTheBackOrTheMiddle) {
  const auto expect = [](const char* header, std::size_t offset, std::size_t length) {
    const auto request = parse_range(header, 100);
    ASSERT_TRUE(request.range) << header;
    EXPECT_EQ(request.range->offset, offset) << header;
    EXPECT_EQ(request.range->length, length) << header;
  };
  expect("bytes=0-9", 0, 10);
  expect("bytes=90-", 90, 10);
  expect("bytes=-5", 95, 5);
  expect("bytes=-500", 0, 100);
  expect("bytes=50-5000", 50, 50);
}

TEST(Conditions, ARangeBeyondTheEndIsNotSatisfiable) {
  EXPECT_FALSE(parse_range("bytes=100-", 100).satisfiable);
  EXPECT_FALSE(parse_range("bytes=-0", 100).satisfiable);
}

TEST(Conditions, SeveralRangesAndMalformedOnesMeanTheWhole) {
  for (const char* header : {"bytes=0-1,5-6", "bytes=9-3", "bytes=a-b", "bytes=-", "lines=0-1",
                             "bytes=1 -2", "bytes=99999999999999999999-"}) {
    const auto request = parse_range(header, 100);
    EXPECT_TRUE(request.satisfiable) << header;
    EXPECT_FALSE(request.range) << header;
  }
}

TEST(Conditions, TheAcceptedTypeOfTheHighestQualityIsServed) {
  constexpr std::array<std::string_view, 2> types{"application/vnd.cellmap.cell",
                                                  "application/json"};
  EXPECT_EQ(negotiate(std::nullopt, types), types[0]);
  EXPECT_EQ(negotiate("*/*", types), types[0]);
  EXPECT_EQ(negotiate("application/*", types), types[0]);
  EXPECT_EQ(negotiate("application/json", types), types[1]);
  EXPECT_EQ(negotiate("application/json;q=0.5, */*;q=0.1", types), types[1]);
  EXPECT_EQ(negotiate("*/*, application/vnd.cellmap.cell;q=0", types), types[1]);
  EXPECT_EQ(negotiate("image/png", types), std::nullopt);
  EXPECT_EQ(negotiate("application/json;q=0", types), std::nullopt);
}

TEST(Conditions, ACodingIsAcceptedByNameOrStarAboveZeroAndNotBelowIdentity) {
  EXPECT_TRUE(accepts_coding("gzip, zstd", "zstd"));
  EXPECT_TRUE(accepts_coding("*", "zstd"));
  EXPECT_TRUE(accepts_coding("ZSTD;q=0.5", "zstd"));
  EXPECT_FALSE(accepts_coding(std::nullopt, "zstd"));
  EXPECT_FALSE(accepts_coding("gzip, br", "zstd"));
  EXPECT_FALSE(accepts_coding("*, zstd;q=0", "zstd"));
  EXPECT_FALSE(accepts_coding("identity, zstd;q=0.5", "zstd"));
}

}  // namespace
}  // namespace cellmap::server
