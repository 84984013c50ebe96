#include "server/api/json_io.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace cellmap::server {
namespace {

using cellmap::test::expect_error;

TEST(JsonIo, RefusesWhatIsNoJson) {
  for (const char* text : {"", "{", "{\"a\":NaN}", "{\"a\":1e999}", "[1] x", "{\"a\":\"\xff\"}"}) {
    expect_error(
        ErrorCode::kInvalidArgument, [&] { parse_json(text); }, "not JSON");
  }
}

TEST(JsonIo, RefusesDeepNestingBeforeItCosts) {
  const std::string deep(1'000'000, '[');
  expect_error(
      ErrorCode::kInvalidArgument, [&] { parse_json(deep); }, "nested deeper");
}

TEST(JsonIo, RefusesAKeyThatComesTwiceInOneObjectOnly) {
  expect_error(
      ErrorCode::kInvalidArgument, [] { parse_json(R"({"a":{"b":1,"b":2}})"); }, "'b'");
  EXPECT_NO_THROW(parse_json(R"({"a":{"b":1},"c":{"b":2}})"));
}

TEST(JsonIo, WritesBytesThatAreNotUtf8WithoutThrowing) {
  EXPECT_EQ(dump(Json("a\xff")), "\"a\xEF\xBF\xBD\"");
}

TEST(JsonIo, NamesAnUnknownMemberAndWhatThereIs) {
  const Json json = parse_json(R"({"name":"x","latice":1})");
  expect_error(
      ErrorCode::kInvalidArgument,
      [&] {
        ObjectReader reader(json, "the map");
        reader.text("name");
        reader.text("lattice");
        reader.finish();
      },
      "latice", "lattice, name");
}

TEST(JsonIo, RefusesPosesThatAreNotFiniteSevenOrUnit) {
  for (const char* pose : {"[0,0,0,0,0,0]", "[0,0,0,0,0,0,2]", "[0,0,0,0,0,0,\"1\"]", "null"}) {
    const Json json = parse_json(std::string("{\"pose\":") + pose + "}");
    expect_error(ErrorCode::kInvalidArgument, [&] { ObjectReader(json, "the loop").pose("pose"); });
  }
}

TEST(JsonIo, WritesASymmetricMatrixAsItsUpperTriangleAndReadsItBack) {
  Matrix6d matrix;
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) matrix(i, j) = std::min(i, j) * 10 + std::max(i, j);
  }
  const Json json{{"m", to_json(matrix)}};
  EXPECT_EQ(json["m"].size(), 21u);
  EXPECT_EQ(json["m"][1], 1);
  EXPECT_EQ(json["m"][6], 11);
  EXPECT_EQ(*ObjectReader(json, "test").matrix("m"), matrix);
}

TEST(JsonIo, WritesTimesAsRfc3339) {
  EXPECT_EQ(to_rfc3339(951'782'400'123'456'789), "2000-02-29T00:00:00.123Z");
}

}  // namespace
}  // namespace cellmap::server
