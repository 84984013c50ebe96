#include "cellmap/client/url.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

TEST(ServerUrl, ReadsSchemeHostPortAndPrefix) {
  EXPECT_EQ(parse_server_url("http://map.example:8080/cell/map/"),
            (ServerUrl{"http", "map.example", 8080, "/cell/map"}));
}

TEST(ServerUrl, SchemeAndPortHaveDefaults) {
  EXPECT_EQ(parse_server_url("localhost:81"), (ServerUrl{"http", "localhost", 81, ""}));
  EXPECT_EQ(parse_server_url("http://10.0.0.1").port, 80);
  EXPECT_EQ(parse_server_url("HTTPS://map.example").port, 443);
}

TEST(ServerUrl, AnIpv6AddressStandsInBrackets) {
  const ServerUrl url = parse_server_url("http://[::1]:9000");
  EXPECT_EQ(url.host, "::1");
  EXPECT_EQ(url.port, 9000);
  EXPECT_EQ(to_string(url), "http://[::1]:9000");
}

TEST(ServerUrl, IsWrittenSoThatItReadsBack) {
  for (const char* text : {"http://a:1", "https://b.example:8443/x", "http://[fe80::1]:2/p/q"}) {
    const ServerUrl url = parse_server_url(text);
    EXPECT_EQ(parse_server_url(to_string(url)), url) << text;
  }
}

class WrongUrl : public testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(WrongUrl, IsRefusedSayingWhatIsWrongAndWhatToWrite) {
  const auto [text, why] = GetParam();
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { parse_server_url(text); }, why, "http://HOST:PORT");
}

INSTANTIATE_TEST_SUITE_P(
    ServerUrl, WrongUrl,
    testing::Values(std::pair("ftp://a", "scheme"), std::pair("http://", "host is missing"),
                    std::pair("", "host is missing"), std::pair("http://a:0", "port"),
                    std::pair("http://a:65536", "port"), std::pair("http://a:8x", "port"),
                    std::pair("http://a:", "port"), std::pair("http://[::1", "bracket"),
                    std::pair("http://me@a", "user name"), std::pair("http://a?x=1", "query"),
                    std::pair("http://a/#x", "fragment"), std::pair("http://a b", "host"),
                    std::pair("http://a/\r\nX: y", "percent-encoded")));

TEST(PercentEncoding, KeepsUnreservedCharactersOnly) {
  EXPECT_EQ(percent_encoded("Az09-._~"), "Az09-._~");
  EXPECT_EQ(percent_encoded("a/b c?\xc3\xa4,"), "a%2Fb%20c%3F%C3%A4%2C");
}

}  // namespace
}  // namespace cellmap
