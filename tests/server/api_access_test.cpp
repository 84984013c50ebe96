#include <array>
#include <map>

#include "cellmap/core/error.hpp"
#include "server/api/access.hpp"
#include "server/guarded_fixture.hpp"

// Who may do what, on every route.

namespace cellmap::server::test {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

class ApiAccess : public GuardedApiTest {};

/// A target that a route takes.
std::string target_of(std::string pattern) {
  const std::vector<std::pair<std::string, std::string>> values{
      {"{map}", "town"}, {"{cell}", "1"},  {"{loop}", "1"}, {"{session}", "drive"},
      {"{job}", "7"},    {"{index}", "0"}, {"{file}", "x"}, {"{hash}", std::string(64, '0')}};
  for (const auto& [name, value] : values) {
    if (const auto at = pattern.find(name); at != pattern.npos) {
      pattern.replace(at, name.size(), value);
    }
  }
  return pattern;
}

struct Way {
  std::string method, pattern;
  std::optional<Scope> scope;
};

/// All routes; HEAD of a GET too, which asks for the same.
std::vector<Way> ways(const Router& router) {
  std::vector<Way> all;
  for (const Route& route : router.routes()) {
    all.push_back({route.method, route.pattern, route.scope});
    if (route.method == "GET") all.push_back({"HEAD", route.pattern, route.scope});
  }
  return all;
}

constexpr std::array kScopes{Scope::kMapRead, Scope::kMapWrite, Scope::kRelocalise, Scope::kAdmin};

TEST_F(ApiAccess, EveryRouteAsksForAToken) {
  std::size_t asked = 0;
  for (const Way& way : ways(api_->router())) {
    const auto response = send(way.method, target_of(way.pattern));
    const auto where = way.method + " " + way.pattern;
    if (!way.scope) {
      EXPECT_NE(response.status, 401) << where;
      EXPECT_NE(response.status, 403) << where;
      continue;
    }
    ++asked;
    EXPECT_EQ(response.status, 401) << where;
    EXPECT_THAT(std::string(body_view(response)), HasSubstr("\"unauthenticated\"")) << where;
    EXPECT_THAT(response.headers.get("WWW-Authenticate").value_or(""), StartsWith("Bearer "));
  }
  EXPECT_GT(asked, 40u);
}

TEST_F(ApiAccess, EveryRouteRefusesATokenWithAllScopesButItsOwn) {
  std::map<Scope, std::string> secrets;
  for (const Way& way : ways(api_->router())) {
    if (!way.scope) continue;
    std::set<Scope> others(kScopes.begin(), kScopes.end());
    others.erase(*way.scope);
    others.erase(Scope::kAdmin);
    const std::string name = "but-" + std::to_string(static_cast<int>(*way.scope));
    auto& secret = secrets[*way.scope];
    if (secret.empty()) secret = add_token(name, others);
    const auto response = send(way.method, target_of(way.pattern), {}, {bearer(secret)});
    const auto where = way.method + " " + way.pattern;
    expect_problem(response, 403, "permission-denied");
    EXPECT_THAT(response.headers.get("WWW-Authenticate").value_or(""),
                HasSubstr("scope=\"" + std::string(to_string(*way.scope)) + "\""))
        << where;
  }
}

TEST_F(ApiAccess, EveryRouteTakesItsScopeAndAdmin) {
  std::map<Scope, std::string> secrets;
  for (const Scope scope : kScopes) {
    secrets[scope] = add_token("s" + std::to_string(static_cast<int>(scope)), {scope});
  }
  for (const Way& way : ways(api_->router())) {
    if (!way.scope || way.method == "DELETE") continue;
    for (const auto& secret : {secrets[*way.scope], secrets[Scope::kAdmin]}) {
      const auto response = send(way.method, target_of(way.pattern), {}, {bearer(secret)});
      EXPECT_NE(response.status, 401) << way.method << " " << way.pattern;
      EXPECT_NE(response.status, 403) << way.method << " " << way.pattern;
    }
  }
}

TEST_F(ApiAccess, EveryRouteOfAMapRefusesATokenOfAnother) {
  const auto secret = add_token("harbour", {Scope::kAdmin}, {"harbour"});
  for (const Way& way : ways(api_->router())) {
    if (way.pattern.find("{map}") == std::string::npos) continue;
    const auto response = send(way.method, target_of(way.pattern), {}, {bearer(secret)});
    EXPECT_EQ(response.status, 403) << way.method << " " << way.pattern;
  }
  // Whether it is there or not.
  EXPECT_EQ(get("/v1/maps/atlantis", {bearer(secret)}).status, 403);
  EXPECT_EQ(get("/v1/maps/harbour", {bearer(secret)}).status, 404);
}

TEST_F(ApiAccess, ATokenOfAMapSeesNoOther) {
  const auto secret = add_token("harbour", {Scope::kMapRead, Scope::kMapWrite}, {"harbour"});
  const std::vector<Headed> own{bearer(secret), json_body()};
  EXPECT_EQ(send("POST", "/v1/maps", R"({"name":"harbour"})", own).status, 201);
  const Json maps = json_of(get("/v1/maps", own)).at("maps");
  ASSERT_EQ(maps.size(), 1u);
  EXPECT_EQ(maps[0].at("name"), "harbour");
}

TEST_F(ApiAccess, ATokenOfAMapNamesNoOtherInABody) {
  const auto secret = add_token("harbour", {Scope::kMapRead, Scope::kMapWrite}, {"harbour"});
  const std::vector<Headed> own{bearer(secret), json_body()};
  send("POST", "/v1/maps", R"({"name":"harbour"})", own);
  expect_problem(send("POST", "/v1/maps", R"({"name":"other"})", own), 403, "permission-denied");
  expect_problem(send("POST", "/v1/maps/harbour/merge", R"({"from":"town"})", own), 403,
                 "permission-denied");
  expect_problem(
      send("POST", "/v1/maps/harbour/split", R"({"sessions":["a"],"into":"other"})", own), 403,
      "permission-denied");
}

TEST_F(ApiAccess, AJobBelongsToItsMap) {
  const auto made =
      send("POST", "/v1/maps/town/jobs", R"({"kind":"ingest","session":"s","upload":true})",
           {bearer(admin_), json_body()});
  ASSERT_EQ(made.status, 202) << body_view(made);
  const std::string job = "/v1/jobs/" + json_of(made).at("id").dump();
  const auto other = add_token("harbour", {Scope::kAdmin}, {"harbour"});
  const auto own = add_token("town", {Scope::kMapRead}, {"town"});
  EXPECT_EQ(get(job, {bearer(other)}).status, 403);
  EXPECT_EQ(get(job + "/events", {bearer(other)}).status, 403);
  EXPECT_EQ(get(job, {bearer(own)}).status, 200);
}

TEST_F(ApiAccess, AnExpiredTokenIsToldSo) {
  const auto secret = add_token("old", {Scope::kAdmin}, {}, auth::time_from_text("2020-01-01"));
  const auto response = get("/v1/maps", {bearer(secret)});
  EXPECT_THAT(expect_problem(response, 401, "unauthenticated"), HasSubstr("expired"));
}

TEST_F(ApiAccess, ARevokedTokenEndsTheStreamsThatItOpened) {
  const auto secret = add_token("follower", {Scope::kMapRead});
  const auto response = get("/v1/maps/town/events", {bearer(secret)});
  const auto& stream = std::get<BodyStream>(response.body);
  std::string chunk;
  EXPECT_TRUE(stream(chunk));
  auth::remove_token(folder_ / "tokens", "follower");
  guard_->reload();
  EXPECT_FALSE(stream(chunk));
}

TEST_F(ApiAccess, TooManyRequestsAreToldWhenToComeAgain) {
  restart({.tokens = {}, .requests_per_s = 1});
  const std::vector<Headed> own{bearer(admin_)};
  EXPECT_EQ(get("/v1/maps", own).status, 200);
  EXPECT_EQ(get("/v1/maps", own).status, 200);
  const auto response = get("/v1/maps", own);
  expect_problem(response, 429, "rate-limited");
  EXPECT_EQ(response.headers.get("Retry-After"), "1");
  EXPECT_EQ(get("/healthz").status, 200);
}

TEST_F(ApiAccess, WhatATokenWasNeededForIsKeptByNoSharedCache) {
  send("PUT", "/v1/maps/town/cells/1", to_text(street_cell(0, 0).bytes),
       {bearer(admin_), {"Content-Type", "application/vnd.cellmap.cell"}});
  const std::string named = "/v1/maps/town/cells/1?hash=" + to_hex(street_cell(0, 0).hash);
  EXPECT_EQ(get("/v1/maps/town/cells/1", {bearer(admin_)}).headers.get("Cache-Control"),
            "private, no-cache");
  const auto cell = get(named, {bearer(admin_)});
  EXPECT_EQ(cell.headers.get("Cache-Control"), "private, max-age=31536000, immutable");
  EXPECT_EQ(get("/v1/maps", {bearer(admin_)}).headers.get("Cache-Control"), "private");
  EXPECT_EQ(get("/healthz").headers.get("Cache-Control"), std::nullopt);
}

TEST_F(ApiAccess, EveryAnswerIsGuardedAgainstBrowsers) {
  for (const auto& response : {get("/v1/maps"), get("/healthz"), get("/"), get("/nowhere"),
                               get("/v1/maps", {bearer(admin_)})}) {
    EXPECT_EQ(response.headers.get("X-Content-Type-Options"), "nosniff");
    EXPECT_EQ(response.headers.get("Referrer-Policy"), "no-referrer");
    const auto policy = response.headers.get("Content-Security-Policy").value_or("");
    EXPECT_THAT(policy, HasSubstr("default-src 'none'"));
    EXPECT_THAT(policy, HasSubstr("frame-ancestors 'none'"));
  }
}

TEST_F(ApiAccess, OtherOriginsReadNothingUnlessTheyAreAllowed) {
  const Headed page{"Origin", "https://maps.example.org"};
  const Headed asks{"Access-Control-Request-Method", "PUT"};
  const auto silent = get("/v1/maps", {bearer(admin_), page});
  EXPECT_EQ(silent.headers.get("Access-Control-Allow-Origin"), std::nullopt);
  EXPECT_EQ(send("OPTIONS", "/v1/maps", {}, {page, asks}).status, 405);

  origins_ = {"https://maps.example.org"};
  restart({});
  const auto answer = get("/v1/maps", {bearer(admin_), page});
  EXPECT_EQ(answer.headers.get("Access-Control-Allow-Origin"), page.value);
  EXPECT_THAT(answer.headers.get("Vary").value_or(""), HasSubstr("Origin"));
  EXPECT_EQ(get("/v1/maps", {page}).headers.get("Access-Control-Allow-Origin"), page.value)
      << "a page has to read why it was refused";
  Request preflight{"OPTIONS", "/v1/maps/town/cells/1", {}, {}, "test", {}, {}, {}};
  preflight.headers.set("Origin", page.value);
  preflight.headers.set("Access-Control-Request-Method", "PUT");
  const auto allowed = api_->handle(preflight);
  EXPECT_EQ(allowed.status, 204);
  EXPECT_EQ(allowed.headers.get("Access-Control-Allow-Origin"), page.value);
  EXPECT_THAT(allowed.headers.get("Access-Control-Allow-Methods").value_or(""), HasSubstr("PUT"));
  EXPECT_THAT(allowed.headers.get("Access-Control-Allow-Headers").value_or(""),
              HasSubstr("Authorization"));
  const auto other = get("/v1/maps", {bearer(admin_), {"Origin", "https://evil.example.org"}});
  EXPECT_EQ(other.headers.get("Access-Control-Allow-Origin"), std::nullopt);
}

TEST_F(ApiAccess, WritesAreAuditedWhateverBecameOfThem) {
  const auto reader = add_token("reader", {Scope::kMapRead});
  Request request{"DELETE", "/v1/maps/town", {}, {}, "request-9", {}, "192.0.2.7", {}};
  request.headers.set("Authorization", "Bearer " + reader);
  api_->handle(request);
  send("POST", "/v1/maps", R"({"name":"x"})", {bearer(admin_), json_body()});
  get("/v1/maps", {bearer(admin_)});
  send("POST", "/v1/maps", R"({"name":"x"})", {bearer(admin_), json_body()});
  const auto lines = audited();
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0].at("request_id"), "request-9");
  EXPECT_EQ(lines[0].at("caller"), "reader");
  EXPECT_EQ(lines[0].at("address"), "192.0.2.7");
  EXPECT_EQ(lines[0].at("method"), "DELETE");
  EXPECT_EQ(lines[0].at("path"), "/v1/maps/town");
  EXPECT_EQ(lines[0].at("map"), "town");
  EXPECT_EQ(lines[0].at("status"), 403);
  EXPECT_EQ(lines[0].at("code"), "permission-denied");
  EXPECT_EQ(lines[1].at("caller"), "root");
  EXPECT_EQ(lines[1].at("status"), 201);
  EXPECT_FALSE(lines[1].contains("code"));
  EXPECT_EQ(lines[2].at("code"), "already-exists");
}

TEST_F(ApiAccess, AnAuditLogThatWasMovedAwayBeginsAnew) {
  send("POST", "/v1/maps", R"({"name":"x"})", {bearer(admin_), json_body()});
  std::filesystem::rename(folder_ / "audit", folder_ / "audit.1");
  send("POST", "/v1/maps", R"({"name":"y"})", {bearer(admin_), json_body()});
  EXPECT_FALSE(std::filesystem::exists(folder_ / "audit"));
  audit_->reopen();
  send("POST", "/v1/maps", R"({"name":"z"})", {bearer(admin_), json_body()});
  EXPECT_EQ(audited().size(), 1u);
}

TEST_F(ApiAccess, AProblemCarriesTheIdOfItsRequest) {
  const auto response = get("/v1/maps/atlantis", {bearer(admin_)});
  EXPECT_EQ(json_of(response).at("request_id"), "test");
  EXPECT_EQ(response.headers.get("X-Request-Id"), "test");
}

TEST(Access, ARouteThatNobodyThoughtOfCannotBeAdded) {
  Router router;
  EXPECT_THROW(
      router.add({"GET", "/v1/secrets", {}, 0, {}, [](const Call&) { return Response(); }}), Error);
}

TEST(Access, RequestIdsThatCouldForgeALogAreNotTaken) {
  const auto given = [](const std::string& id) {
    Headers headers;
    headers.set("X-Request-Id", id);
    return given_request_id(headers).value_or("");
  };
  EXPECT_EQ(given("0af7651916cd43dd8448eb211c80319c"), "0af7651916cd43dd8448eb211c80319c");
  EXPECT_EQ(given("a.b_c-d"), "a.b_c-d");
  for (const std::string& bad : {std::string(""), std::string("a b"), std::string("a\nb"),
                                 std::string("a\"b"), std::string("[x] "), std::string(65, 'a')}) {
    EXPECT_EQ(given(bad), "") << bad;
  }
}

TEST(Access, OriginsAreOrigins) {
  EXPECT_NO_THROW(CrossOrigin({"https://a.example:8443", "*", "http://[::1]:3000"}));
  for (const char* bad : {"a.example", "https://", "https://a.example/", "https://a b"}) {
    EXPECT_THROW(CrossOrigin({bad}), Error) << bad;
  }
}

}  // namespace
}  // namespace cellmap::server::test
