#include <filesystem>

#include "server/guarded_fixture.hpp"
#include "server/http_fixture.hpp"

// Tokens and request ids over sockets.

namespace cellmap::server::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class HttpAccess : public HttpTest<GuardedApiTest> {
 protected:
  /// Makes a map by a request with these headers too; what the audit log says of it.
  Json audited_post(const std::string& headers) {
    const std::string body = R"({"name":"new"})";
    const auto answer =
        exchange("POST /v1/maps HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" + headers +
                 "Content-Type: application/json\r\nAuthorization: Bearer " + admin_ +
                 "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 201"));
    const auto lines = audited();
    EXPECT_EQ(lines.size(), 1u);
    return lines.empty() ? Json::object() : lines.front();
  }
};
using HttpIds = HttpTest<ApiTest>;

TEST_F(HttpAccess, WhoMayNotSendABodyHasNoneOfItRead) {
  serve();
  // A client that waits for its answer before it sends a byte of what it announced.
  for (const std::string& announced :
       {std::string("Content-Length: 9000000000"), std::string("Transfer-Encoding: chunked")}) {
    const auto answer = exchange("PUT /v1/maps/new/archive HTTP/1.1\r\nHost: x\r\n" + announced +
                                 "\r\nContent-Type: application/vnd.cellmap.archive\r\n\r\n");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 401"));
    EXPECT_THAT(answer, HasSubstr("\r\nConnection: close\r\n"));
    EXPECT_THAT(answer, HasSubstr("\r\nWWW-Authenticate: Bearer"));
  }
}

TEST_F(HttpAccess, ATokenOpensWhatItIsFor) {
  serve();
  EXPECT_THAT(get_and_close("/v1/maps"), StartsWith("HTTP/1.1 401"));
  EXPECT_THAT(get_and_close("/v1/maps", "Authorization: Bearer " + admin_ + "\r\n"),
              StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(get_and_close("/v1/maps",
                            "Authorization: Bearer x\r\nAuthorization: Bearer " + admin_ + "\r\n"),
              StartsWith("HTTP/1.1 401"));
}

TEST_F(HttpAccess, TheAuditLogSaysWhereAWriteCameFrom) {
  serve();
  const auto line = audited_post(
      "X-Request-Id: mine-1\r\nREMOTE_ADDR: 203.0.113.9\r\nX-Forwarded-For: 203.0.113.9\r\n");
  EXPECT_EQ(line.at("address"), "127.0.0.1");
  EXPECT_EQ(line.at("request_id"), "mine-1");
}

TEST_F(HttpAccess, ATrustedProxySaysWhereAWriteCameFrom) {
  HttpServerOptions options;
  options.trusted_proxies = {"127.0.0.1"};
  serve(options);
  const auto line = audited_post("X-Forwarded-For: 192.0.2.1\r\nX-Forwarded-For: 203.0.113.9\r\n");
  EXPECT_EQ(line.at("address"), "203.0.113.9");
}

TEST_F(HttpIds, ASaneIdOfTheClientIsKeptAndAnotherReplaced) {
  serve();
  EXPECT_THAT(get_and_close("/healthz", "X-Request-Id: trace.7\r\n"),
              HasSubstr("\r\nX-Request-Id: trace.7\r\n"));
  const auto answer = get_and_close("/nowhere", "X-Request-Id: a \"b\"\r\n");
  EXPECT_THAT(answer, Not(HasSubstr("a \"b\"")));
  const auto begin = answer.find("X-Request-Id: ") + 14;
  const auto id = answer.substr(begin, answer.find("\r\n", begin) - begin);
  EXPECT_THAT(answer, HasSubstr("\"request_id\":\"" + id + "\""));
}

TEST_F(HttpIds, WhatTheFrontRefusesHasAnIdAndGuardsAgainstBrowsersToo) {
  serve();
  for (const std::string& request :
       {std::string("HELLO\r\n\r\n"), "GET /" + std::string(9000, 'a') + " HTTP/1.1\r\n\r\n",
        std::string("BREW / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")}) {
    const auto answer = exchange(request);
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 4"));
    EXPECT_THAT(answer, HasSubstr("\r\nX-Request-Id: "));
    EXPECT_THAT(answer, HasSubstr("\r\nX-Content-Type-Options: nosniff\r\n"));
  }
}

}  // namespace
}  // namespace cellmap::server::test
