#include <SQLiteCpp/SQLiteCpp.h>

#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

using ::testing::HasSubstr;

class ApiMaps : public ApiTest {};

TEST_F(ApiMaps, ServicePagesAnswer) {
  EXPECT_THAT(std::string(body_view(get("/"))), HasSubstr("/openapi.yaml"));
  EXPECT_EQ(json_of(get("/healthz"))["status"], "ok");
  EXPECT_EQ(json_of(get("/readyz"))["status"], "ready");
  EXPECT_EQ(std::string(body_view(get("/openapi.yaml"))), openapi_text());
  EXPECT_THAT(openapi_text(), HasSubstr("openapi: 3.1.0"));
}

TEST_F(ApiMaps, AStoppingServerIsNotReady) {
  api_->stop();
  expect_problem(get("/readyz"), 503, "unavailable");
}

TEST_F(ApiMaps, RequestsAreCountedByRouteNotByPath) {
  get("/v1/maps/atlantis");
  const std::string metrics(body_view(get("/metrics")));
  EXPECT_THAT(metrics, HasSubstr("route=\"/v1/maps/{map}\""));
  EXPECT_THAT(metrics, ::testing::Not(HasSubstr("atlantis")));
}

TEST_F(ApiMaps, MetricsAreThereWhileTheStoreIsNot) {
  EXPECT_THAT(std::string(body_view(get("/metrics"))), HasSubstr("\ncellmap_store_up 1\n"));
  SQLite::Database(folder_.path() / "store.db", SQLite::OPEN_READWRITE)
      .exec("ALTER TABLE map RENAME TO away");
  const Response answer = get("/metrics");
  EXPECT_EQ(answer.status, 200);
  const std::string metrics(body_view(answer));
  EXPECT_THAT(metrics, HasSubstr("\ncellmap_store_up 0\n"));
  EXPECT_THAT(metrics, ::testing::Not(HasSubstr("cellmap_maps")));
  EXPECT_THAT(metrics, HasSubstr("http_requests_total"));
}

TEST_F(ApiMaps, AMapIsMadeSummarisedListedAndDeleted) {
  const auto made = post("/v1/maps", R"({"name":"town"})");
  EXPECT_EQ(made.status, 201);
  EXPECT_EQ(made.headers.get("Location"), "/v1/maps/town");
  const Json summary = json_of(get("/v1/maps/town"));
  EXPECT_EQ(summary["lattice"]["size"], 50'000);
  EXPECT_EQ(summary["revision"], 0);
  EXPECT_TRUE(summary["bounds"].is_null());
  EXPECT_EQ(json_of(get("/v1/maps"))["maps"].size(), 1u);
  EXPECT_EQ(send("DELETE", "/v1/maps/town").status, 204);
  expect_problem(get("/v1/maps/town"), 404, "not-found");
  expect_problem(send("DELETE", "/v1/maps/town"), 404, "not-found");
}

TEST_F(ApiMaps, WrongMapsAreRefusedWithTheRightCode) {
  make_map();
  expect_problem(post("/v1/maps", R"({"name":"town"})"), 409, "already-exists");
  expect_problem(post("/v1/maps", R"({"name":"../etc"})"), 400, "invalid-argument");
  expect_problem(post("/v1/maps", R"({})"), 400, "invalid-argument");
  expect_problem(post("/v1/maps", R"({"name":"a","nam":1})"), 400, "invalid-argument");
  expect_problem(post("/v1/maps", R"({"name":"a","name":"b"})"), 400, "invalid-argument");
  expect_problem(post("/v1/maps", R"({"name":)"), 400, "invalid-argument");
  expect_problem(post("/v1/maps", std::string(1000, '[')), 400, "invalid-argument");
  expect_problem(post("/v1/maps", R"({"name":"a","lattice":{"kind":"cube"}})"), 415, "unsupported");
  expect_problem(post("/v1/maps", R"({"name":"a","lattice":{"size":3}})"), 415, "unsupported");
  expect_problem(post("/v1/maps", std::string(100'000, ' ')), 413, "too-large");
  expect_problem(send("POST", "/v1/maps", R"({"name":"a"})", {{"Content-Type", "text/plain"}}), 415,
                 "unsupported");
  EXPECT_EQ(json_of(get("/v1/maps"))["maps"].size(), 1u);
}

TEST_F(ApiMaps, UnknownPathsMethodsAndTypesHaveProblems) {
  EXPECT_THAT(expect_problem(get("/v2/maps"), 404, "not-found"), HasSubstr("/v2/maps"));
  const auto method = send("PATCH", "/v1/maps");
  expect_problem(method, 405, "method-not-allowed");
  EXPECT_EQ(method.headers.get("Allow"), "GET, HEAD, POST");
  expect_problem(get("/v1/maps", {{"Accept", "image/png"}}), 406, "not-acceptable");
  expect_problem(get("/v1/maps?x=%zz"), 400, "invalid-argument");
  EXPECT_EQ(json_of(get("/v1/maps/none?a=b"))["instance"], "/v1/maps/none");
}

TEST_F(ApiMaps, HeadAnswersAsGetDoes) {
  make_map();
  const auto head = send("HEAD", "/v1/maps/town");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(body_view(head), body_view(get("/v1/maps/town")));
}

TEST_F(ApiMaps, EveryAnswerNamesItsRequest) {
  EXPECT_EQ(get("/healthz").headers.get("X-Request-Id"), "test");
  EXPECT_EQ(get("/nothing").headers.get("X-Request-Id"), "test");
}

TEST_F(ApiMaps, AMapSurvivesARestart) {
  make_map();
  start();
  EXPECT_EQ(json_of(get("/v1/maps/town"))["lattice"]["size"], 6000);
}

TEST_F(ApiMaps, AMapMadeAnewUnderAnOldNameHasNothingOfTheOldOne) {
  make_map();
  put_street(1);
  EXPECT_EQ(
      json_of(get("/v1/maps/town/pose-graph", {{"Accept", "application/json"}}))["nodes"].size(),
      1u);
  send("DELETE", "/v1/maps/town");
  make_map();
  EXPECT_EQ(
      json_of(get("/v1/maps/town/pose-graph", {{"Accept", "application/json"}}))["nodes"].size(),
      0u);
}

}  // namespace
}  // namespace cellmap::server::test
