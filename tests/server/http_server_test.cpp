#include "cellmap/core/error.hpp"
#include "server/http_fixture.hpp"

// The front over loopback, spoken to byte by byte.

namespace cellmap::server::test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

using Http = HttpTest<ApiTest>;

constexpr const char* kHealth = "GET /healthz HTTP/1.1\r\nHost: x\r\n\r\n";

TEST_F(Http, AnswersWithTheBodyOfTheApi) {
  serve();
  const auto answer = get_and_close("/healthz");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("\r\nX-Request-Id: "));
  EXPECT_THAT(answer, HasSubstr("\r\n\r\n{\"status\":\"ok\"}"));
}

TEST_F(Http, AKeptConnectionTakesManyRequests) {
  serve();
  Client client(server_->port());
  for (int i = 0; i < 50; ++i) {
    ASSERT_TRUE(client.send(kHealth));
    ASSERT_THAT(client.read_until("\"ok\"}"), StartsWith("HTTP/1.1 200")) << "request " << i;
  }
}

TEST_F(Http, PipelinedRequestsAreAllAnswered) {
  serve();
  Client client(server_->port());
  client.send(std::string(kHealth) + kHealth +
              "GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  const std::string all = client.read_all();
  std::size_t answers = 0;
  for (auto at = all.find("\"ok\"}"); at != std::string::npos; at = all.find("\"ok\"}", at + 1)) {
    ++answers;
  }
  EXPECT_EQ(answers, 3u);
}

TEST_F(Http, HeadStatesTheLengthAndSendsNothing) {
  serve();
  const auto answer = exchange("HEAD /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(answer, HasSubstr("Content-Length: 15\r\n"));
  EXPECT_THAT(answer, ::testing::EndsWith("\r\n\r\n"));
}

TEST_F(Http, ABodyIsReadByLengthAndInChunks) {
  serve();
  const std::string head =
      "POST /v1/maps HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
      "Connection: close\r\n";
  EXPECT_THAT(exchange(head + "Content-Length: 12\r\n\r\n{\"name\":\"a\"}"),
              StartsWith("HTTP/1.1 201"));
  EXPECT_THAT(exchange(head + "Transfer-Encoding: chunked\r\n\r\n"
                              "5\r\n{\"nam\r\n7\r\ne\":\"b\"}\r\n0\r\n\r\n"),
              StartsWith("HTTP/1.1 201"));
}

TEST_F(Http, AChunkedBodyOverItsLimitIsRefusedWhileItComes) {
  serve();
  Client client(server_->port());
  client.send(
      "POST /v1/maps HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
      "Transfer-Encoding: chunked\r\n\r\n");
  const std::string chunk = "1000\r\n" + std::string(0x1000, ' ') + "\r\n";
  for (int i = 0; i < 1000 && client.send(chunk); ++i) {
  }
  const auto answer = client.read_all();
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 413"));
  EXPECT_THAT(answer, HasSubstr("\"code\":\"too-large\""));
}

TEST_F(Http, ALargeBodyOfUnknownLengthIsTakenAndBounded) {
  ApiOptions small = options();
  small.max_archive_bytes = 100'000;
  start(small);
  serve();
  const std::string head =
      "PUT /v1/maps/m/archive HTTP/1.1\r\nHost: x\r\nConnection: close\r\n"
      "Content-Type: application/vnd.cellmap.archive\r\nTransfer-Encoding: chunked\r\n\r\n";
  const std::string chunk = "4000\r\n" + std::string(0x4000, ' ') + "\r\n";
  EXPECT_THAT(exchange(head + chunk + chunk + "0\r\n\r\n"), StartsWith("HTTP/1.1 422"));
  Client client(server_->port());
  client.send(head);
  for (int i = 0; i < 1000 && client.send(chunk); ++i) {
  }
  EXPECT_THAT(client.read_all(), StartsWith("HTTP/1.1 413"));
}

TEST_F(Http, AFileIsSentWithItsLength) {
  make_map();
  put_street(2);
  serve();
  const auto answer = get_and_close("/v1/maps/town/archive");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  const auto length = answer.size() - answer.find("\r\n\r\n") - 4;
  EXPECT_THAT(answer, HasSubstr("Content-Length: " + std::to_string(length) + "\r\n"));
  const auto part = get_and_close("/v1/maps/town/archive", "Range: bytes=0-7\r\n");
  EXPECT_THAT(part, StartsWith("HTTP/1.1 206"));
  EXPECT_THAT(part, ::testing::EndsWith("\r\n\r\n\x89"
                                        "CELLMAP"));
}

TEST_F(Http, ADeclaredBodyOverItsLimitIsRefusedUnread) {
  serve();
  EXPECT_THAT(exchange("POST /v1/maps HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999\r\n\r\n"),
              StartsWith("HTTP/1.1 413"));
}

TEST_F(Http, ABodyThatNobodyReadIsNotTheNextRequest) {
  serve();
  const std::string smuggled = "DELETE /v1/maps/town HTTP/1.1\r\nHost: x\r\n\r\n";
  make_map();
  for (const std::string& start : {std::string("GET /healthz"), std::string("POST /nowhere"),
                                   std::string("DELETE /healthz"), std::string("OPTIONS /")}) {
    const auto answer = exchange(start + " HTTP/1.1\r\nHost: x\r\nContent-Length: " +
                                 std::to_string(smuggled.size()) + "\r\n\r\n" + smuggled);
    EXPECT_EQ(answer.find("HTTP/1.1", 1), std::string::npos) << start << "\n" << answer;
  }
  EXPECT_EQ(get("/v1/maps/town").status, 200);
}

TEST_F(Http, CompressedAndAmbiguousBodiesAreRefused) {
  serve();
  const std::string post =
      "POST /v1/maps HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n";
  EXPECT_THAT(exchange(post + "Content-Encoding: gzip\r\nContent-Length: 2\r\n\r\n{}"),
              StartsWith("HTTP/1.1 415"));
  EXPECT_THAT(exchange(post + "Content-Length: 2\r\nTransfer-Encoding: chunked\r\n\r\n{}"),
              StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(exchange(post + "Content-Length: 2\r\nContent-Length: 3\r\n\r\n{}"),
              StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(exchange(post + "Content-Length: 2x\r\n\r\n{}"), StartsWith("HTTP/1.1 400"));
}

TEST_F(Http, HeadsHaveLimits) {
  serve();
  EXPECT_THAT(get_and_close("/" + std::string(9000, 'a')), StartsWith("HTTP/1.1 414"));
  EXPECT_THAT(get_and_close("/healthz", "X: " + std::string(70'000, 'a') + "\r\n"),
              StartsWith("HTTP/1.1 4"));
  std::string many;
  for (int i = 0; i < 200; ++i) many += "X-" + std::to_string(i) + ": y\r\n";
  EXPECT_THAT(get_and_close("/healthz", many), StartsWith("HTTP/1.1 431"));
  EXPECT_THAT(get_and_close("/healthz", "X: a%0d%0ab\r\n"), StartsWith("HTTP/1.1 400"));
}

TEST_F(Http, WhatIsNoHttpGetsAProblemAndTheConnectionEnds) {
  serve();
  const auto answer = exchange("HELLO\r\n\r\n");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 400"));
  EXPECT_THAT(answer, HasSubstr("application/problem+json"));
}

TEST_F(Http, SeveralRangesDoNotMultiplyTheAnswer) {
  serve();
  make_map();
  put_street(1);
  const auto size = street_cell(0, 0).bytes.size();
  std::string ranges = "Range: bytes=0-";
  for (int i = 0; i < 500; ++i) ranges += ",0-";
  const auto many = get_and_close("/v1/maps/town/cells/1", ranges + "\r\n");
  EXPECT_THAT(many, StartsWith("HTTP/1.1 200"));
  EXPECT_LT(many.size(), size + 2000);
  const auto one = get_and_close("/v1/maps/town/cells/1", "Range: bytes=0-9\r\n");
  EXPECT_THAT(one, StartsWith("HTTP/1.1 206"));
  EXPECT_THAT(one, HasSubstr("Content-Length: 10\r\n"));
}

TEST_F(Http, WhatFailsInsideTellsNothingOfTheInside) {
  const std::string inside = (folder_ / "no-such-spool").string();
  ApiOptions broken = options();
  broken.spool_folder = inside;
  start(broken);
  make_map();
  serve();
  // In the front, before the API is asked, and in a handler.
  const auto put = exchange(
      "PUT /v1/maps/new/archive HTTP/1.1\r\nHost: x\r\nConnection: close\r\n"
      "Content-Type: application/vnd.cellmap.archive\r\nContent-Length: 1\r\n\r\nx");
  for (const auto& answer : {put, get_and_close("/v1/maps/town/archive")}) {
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 500"));
    EXPECT_THAT(answer, HasSubstr("application/problem+json"));
    EXPECT_THAT(answer, Not(HasSubstr("spool")));
    EXPECT_THAT(answer, Not(HasSubstr("EXCEPTION")));
  }
}

TEST_F(Http, SixteenEventStreamsHoldUpNobody) {
  serve();
  make_map();
  std::vector<std::unique_ptr<Client>> followers;
  for (int i = 0; i < 20; ++i) {
    followers.push_back(std::make_unique<Client>(server_->port()));
    followers.back()->send("GET /v1/maps/town/events HTTP/1.1\r\nHost: x\r\n\r\n");
    EXPECT_THAT(followers.back()->read_until("event: revision"), HasSubstr("text/event-stream"));
  }
  EXPECT_THAT(get_and_close("/healthz"), StartsWith("HTTP/1.1 200"));
}

TEST_F(Http, JsonIsNotCompressedByTheFront) {
  serve();
  const auto answer = get_and_close("/v1/maps", "Accept-Encoding: gzip, br\r\n");
  EXPECT_THAT(answer, Not(HasSubstr("Content-Encoding")));
  EXPECT_THAT(answer, HasSubstr("{\"maps\":[]}"));
}

TEST_F(Http, AHundredIdleConnectionsDoNotHoldUpARequest) {
  serve();
  std::vector<std::unique_ptr<Client>> idle;
  for (int i = 0; i < 100; ++i) {
    idle.push_back(std::make_unique<Client>(server_->port()));
    ASSERT_TRUE(idle.back()->is_connected());
    if (i % 2) idle.back()->send("GET /healthz HT");  // and half of a head
  }
  EXPECT_THAT(get_and_close("/healthz"), StartsWith("HTTP/1.1 200"));
}

TEST_F(Http, BeyondTheLimitTheLongestIdleConnectionMakesRoom) {
  HttpServerOptions few;
  few.front.max_connections = 4;
  serve(few);
  std::vector<std::unique_ptr<Client>> idle;
  for (int i = 0; i < 20; ++i) idle.push_back(std::make_unique<Client>(server_->port()));
  EXPECT_THAT(get_and_close("/healthz"), StartsWith("HTTP/1.1 200"));
}

/// Fewer quick workers than there are clients that give them nothing to do.
HttpServerOptions two_workers() {
  HttpServerOptions options;
  options.front.quick_workers = 2;
  return options;
}

TEST_F(Http, WhoSendsABodySlowlyHoldsUpNobody) {
  serve(two_workers());
  std::vector<std::unique_ptr<Client>> slow;
  for (int i = 0; i < 20; ++i) {
    slow.push_back(std::make_unique<Client>(server_->port()));
    slow.back()->send(
        "POST /v1/maps HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
        "Content-Length: 12\r\n\r\n{\"nam");
  }
  EXPECT_THAT(get_and_close("/healthz"), StartsWith("HTTP/1.1 200"));
  slow.front()->send("e\":\"a\"}");
  EXPECT_THAT(slow.front()->read_until("\r\n\r\n"), StartsWith("HTTP/1.1 201"));
}

TEST_F(Http, WhoDoesNotReadItsAnswersHoldsUpNobody) {
  serve(two_workers());
  make_map();
  put_street(1);
  std::vector<std::unique_ptr<Client>> deaf;
  for (int i = 0; i < 8; ++i) {
    deaf.push_back(std::make_unique<Client>(server_->port()));
    // More than the sockets of both sides hold.
    std::string requests;
    for (int k = 0; k < 200; ++k)
      requests += "GET /v1/maps/town/cells/1 HTTP/1.1\r\nHost: x\r\n\r\n";
    deaf.back()->send(requests);
  }
  EXPECT_THAT(get_and_close("/healthz"), StartsWith("HTTP/1.1 200"));
  const std::string late = deaf.front()->read_until("never", 200 * street_cell(0, 0).bytes.size());
  EXPECT_GE(late.size(), 200 * street_cell(0, 0).bytes.size());
}

TEST_F(Http, FollowersHoldUpNobody) {
  serve(two_workers());
  make_map();
  std::vector<std::unique_ptr<Client>> followers;
  for (int i = 0; i < 10; ++i) {
    followers.push_back(std::make_unique<Client>(server_->port()));
    followers.back()->send(
        "GET /v1/maps/town/changes?since=0&wait_s=20 HTTP/1.1\r\nHost: x\r\n\r\n");
  }
  EXPECT_THAT(get_and_close("/healthz"), StartsWith("HTTP/1.1 200"));
}

TEST_F(Http, AHeadThatTakesTooLongIsToldSo) {
  HttpServerOptions hurried;
  hurried.front.head_timeout = std::chrono::milliseconds(150);
  serve(hurried);
  Client client(server_->port());
  client.send("GET /healthz HT");
  EXPECT_THAT(client.read_all(), StartsWith("HTTP/1.1 408"));
}

TEST_F(Http, WhatIsBeingAnsweredWhenTheServerStopsIsAnswered) {
  serve();
  make_map();
  Client waiting(server_->port()), idle(server_->port());
  waiting.send("GET /v1/maps/town/changes?since=0&wait_s=1 HTTP/1.1\r\nHost: x\r\n\r\n");
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // until it is at its handler
  server_->stop();
  EXPECT_THAT(waiting.read_until("\r\n\r\n"), StartsWith("HTTP/1.1 200"));
  EXPECT_EQ(idle.read_all(), "");
}

TEST_F(Http, ListensOnSeveralAddressesOfAllKinds) {
  const std::string path = (folder_ / "socket").string();
  HttpServerOptions options;
  options.listen = {"127.0.0.1:0", "unix:" + path};
  serve(options);
  ASSERT_EQ(server_->urls().size(), 2u);
  EXPECT_EQ(server_->urls()[1], "unix:" + path);
  Client local(path);
  local.send("GET /healthz HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(local.read_all(), StartsWith("HTTP/1.1 200"));
}

TEST_F(Http, EventsStreamAndEndWhenTheServerStops) {
  serve();
  const auto made = post("/v1/maps/town/jobs",
                         R"({"kind":"ingest","session":"s","upload":true,"create_map":true})");
  Client client(server_->port());
  client.send("GET /v1/jobs/" + json_of(made)["id"].dump() + "/events HTTP/1.1\r\nHost: x\r\n\r\n");
  EXPECT_THAT(client.read_until("event: progress"), HasSubstr("text/event-stream"));
  api_->stop();
  client.read_until("0\r\n\r\n");  // the last chunk, or the end of the connection
}

TEST_F(Http, AnAddressThatIsTakenIsAnError) {
  serve();
  HttpServerOptions taken;
  taken.listen = {"127.0.0.1:" + std::to_string(server_->port())};
  const auto log =
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::null_sink_mt>());
  EXPECT_THROW(HttpServer(*api_, log, taken), cellmap::Error);
}

}  // namespace
}  // namespace cellmap::server::test
