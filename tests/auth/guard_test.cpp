#include "server/auth/guard.hpp"

#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <fstream>
#include <thread>
#include <vector>

#include "cellmap/core/error.hpp"
#include "server/auth/token_file.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::auth {
namespace {

using std::chrono::seconds;

class GuardTest : public ::testing::Test {
 protected:
  std::string add(const std::string& name, std::set<Scope> scopes, std::set<std::string> maps = {},
                  std::optional<Time> expires = {}, std::optional<double> rate = {}) {
    const auto secret = make_secret();
    add_token(file_,
              {name, hash_of_secret(secret), std::move(scopes), std::move(maps), expires, rate});
    return secret;
  }
  static Demand demand(const std::string& secret, std::optional<Scope> scope = Scope::kMapRead) {
    return {scope, {}, "Bearer " + secret, "192.0.2.1"};
  }

  test::TempFolder folder_;
  const std::filesystem::path file_ = folder_ / "tokens";
};

TEST_F(GuardTest, KnowsWhoATokenStandsFor) {
  const auto secret = add("cart", {Scope::kMapRead});
  Guard guard({.tokens = file_});
  const auto verdict = guard.admit(demand(secret));
  EXPECT_EQ(verdict.refusal, Refusal::kNone);
  EXPECT_EQ(verdict.caller.name, "cart");
  auto sent = demand(secret);
  sent.field = "bEaReR  " + secret;
  EXPECT_EQ(guard.admit(sent).refusal, Refusal::kNone);
}

TEST_F(GuardTest, WhatIsNoTokenOfItsIsRefused) {
  const auto secret = add("cart", {Scope::kMapRead});
  Guard guard({.tokens = file_, .failures_per_s = 1000});
  auto sent = demand(secret);
  sent.field.reset();
  EXPECT_EQ(guard.admit(sent).refusal, Refusal::kNoToken);
  for (const std::string& field :
       {std::string(""), std::string("Bearer"), std::string("Bearer "), "Basic " + secret, secret,
        "Bearer " + secret + " ", "Bearer " + secret + ", Bearer " + secret,
        "Bearer " + secret.substr(1), "Bearer " + std::string(1000, 'a')}) {
    sent.field = field;
    EXPECT_EQ(guard.admit(sent).refusal, Refusal::kUnknownToken) << field;
  }
}

TEST_F(GuardTest, AdminIncludesAllScopesAndTheOthersOnlyThemselves) {
  constexpr std::array kAll{Scope::kMapRead, Scope::kMapWrite, Scope::kRelocalise, Scope::kAdmin};
  for (const Scope has : kAll) add(std::string(1, "rwla"[static_cast<int>(has)]), {has});
  const auto tokens = read_token_file(file_);
  for (const Token& token : tokens) {
    for (const Scope asked : kAll) {
      const Scope has = *token.scopes.begin();
      EXPECT_EQ(token.allows(asked), has == asked || has == Scope::kAdmin);
    }
  }
}

TEST_F(GuardTest, ScopesAndMapsAreHeld) {
  const auto secret = add("cart", {Scope::kMapRead}, {"town"});
  Guard guard({.tokens = file_});
  EXPECT_EQ(guard.admit(demand(secret, Scope::kMapWrite)).refusal, Refusal::kScope);
  auto sent = demand(secret);
  sent.map = "town";
  EXPECT_EQ(guard.admit(sent).refusal, Refusal::kNone);
  sent.map = "harbour";
  EXPECT_EQ(guard.admit(sent).refusal, Refusal::kMap);
}

TEST_F(GuardTest, ATokenIsGoodBeforeItExpires) {
  const auto now = std::chrono::floor<seconds>(std::chrono::system_clock::now());
  const auto old = add("old", {Scope::kAdmin}, {}, now - seconds(1));
  const auto young = add("young", {Scope::kAdmin}, {}, now + std::chrono::hours(1));
  Guard guard({.tokens = file_});
  EXPECT_EQ(guard.admit(demand(old)).refusal, Refusal::kExpired);
  EXPECT_EQ(guard.admit(demand(young)).refusal, Refusal::kNone);
}

TEST_F(GuardTest, AReloadForgetsRevokedTokensAndABadFileChangesNothing) {
  const auto a = add("a", {Scope::kMapRead}), b = add("b", {Scope::kMapRead});
  Guard guard({.tokens = file_});
  const auto admitted = guard.admit(demand(a)).caller.token;
  remove_token(file_, "a");
  EXPECT_EQ(guard.admit(demand(a)).refusal, Refusal::kNone);
  EXPECT_TRUE(guard.still_knows(*admitted));
  guard.reload();
  EXPECT_EQ(guard.admit(demand(a)).refusal, Refusal::kUnknownToken);
  EXPECT_FALSE(guard.still_knows(*admitted));
  std::ofstream(file_) << "nonsense\n";
  EXPECT_THROW(guard.reload(), Error);
  EXPECT_EQ(guard.admit(demand(b)).refusal, Refusal::kNone);
}

TEST_F(GuardTest, ManyAskWhileTheFileIsReadAgain) {
  const auto kept = add("kept", {Scope::kMapRead}), going = add("going", {Scope::kMapRead});
  Guard guard({.tokens = file_, .requests_per_s = 1e5});
  std::atomic<int> refused = 0;
  std::vector<std::thread> askers;
  for (int i = 0; i < 4; ++i) {
    askers.emplace_back([&, i] {
      for (int k = 0; k < 500; ++k) {
        if (guard.admit(demand(kept)).refusal != Refusal::kNone) ++refused;
        const auto other = guard.admit(demand(going));
        if (other.caller.token) guard.still_knows(*other.caller.token);
        guard.admit({Scope::kMapRead, {}, "Bearer guess", std::to_string(i)});
      }
    });
  }
  remove_token(file_, "going");
  for (int i = 0; i < 20; ++i) guard.reload();
  for (auto& asker : askers) asker.join();
  EXPECT_EQ(refused, 0);
  EXPECT_EQ(guard.token_count(), 1u);
}

TEST_F(GuardTest, WithoutTokensNobodyIsAsked) {
  Guard guard({});
  EXPECT_FALSE(guard.asks_for_tokens());
  EXPECT_EQ(guard.admit({Scope::kAdmin, "town", {}, "::1"}).refusal, Refusal::kNone);
}

TEST_F(GuardTest, RatesAreOfEachTokenOrOfEachAddress) {
  const auto slow = add("slow", {Scope::kMapRead}, {}, {}, 1);  // a burst of two
  const auto free = add("free", {Scope::kMapRead}, {}, {}, 0);
  Guard guard({.tokens = file_, .requests_per_s = 2});
  EXPECT_EQ(guard.admit(demand(slow)).refusal, Refusal::kNone);
  EXPECT_EQ(guard.admit(demand(slow)).refusal, Refusal::kNone);
  const auto third = guard.admit(demand(slow));
  EXPECT_EQ(third.refusal, Refusal::kTooMany);
  EXPECT_GT(third.wait_s, 0);
  EXPECT_LE(third.wait_s, 1);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(guard.admit(demand(free)).refusal, Refusal::kNone);

  Guard open({.tokens = {}, .requests_per_s = 0.001});
  const Demand here{Scope::kMapRead, {}, {}, "192.0.2.1"}, there{Scope::kMapRead, {}, {}, "::1"};
  EXPECT_EQ(open.admit(here).refusal, Refusal::kNone);
  EXPECT_EQ(open.admit(here).refusal, Refusal::kTooMany);
  EXPECT_EQ(open.admit(there).refusal, Refusal::kNone);
  EXPECT_EQ(open.admit({std::nullopt, {}, {}, "192.0.2.1"}).refusal, Refusal::kNone);
}

/// He was charged where he asked; who asks servers' routes himself is bounded all the same.
TEST_F(GuardTest, WhatServersAskOnBehalfOfATokenCountsApartAndSoManyTimesAsMuch) {
  const auto secret = add("cart", {Scope::kRelocalise});
  Guard guard({.tokens = file_, .requests_per_s = 2});
  const auto admitted = [&](std::size_t for_servers) {
    Demand one = demand(secret, Scope::kRelocalise);
    one.for_servers = for_servers;
    int count = 0;
    while (count < 100 && guard.admit(one).refusal == Refusal::kNone) ++count;
    return count;
  };
  EXPECT_NEAR(admitted(0), 4, 1);  // two seconds' worth
  EXPECT_NEAR(admitted(3), 12, 1);
  EXPECT_EQ(admitted(0), 0);
  EXPECT_EQ(admitted(3), 0);
}

TEST_F(GuardTest, GuessingIsSlowedDownAndHurtsNobodyElse) {
  const auto secret = add("cart", {Scope::kMapRead});
  Guard guard({.tokens = file_, .failures_per_s = 0.5});
  EXPECT_EQ(guard.admit(demand("guess1")).refusal, Refusal::kUnknownToken);
  EXPECT_EQ(guard.admit(demand("guess2")).refusal, Refusal::kTooMany);
  EXPECT_EQ(guard.admit(demand(secret)).refusal, Refusal::kNone);
}

TEST(RateLimiter, FillsAtItsRate) {
  RateLimiter limiter;
  const auto start = RateLimiter::Clock::now();
  for (int i = 0; i < 20; ++i) EXPECT_EQ(limiter.take("a", 10, start).count(), 0);
  EXPECT_NEAR(limiter.take("a", 10, start).count(), 0.1, 1e-9);
  EXPECT_EQ(limiter.take("a", 10, start + std::chrono::milliseconds(101)).count(), 0);
  EXPECT_GT(limiter.take("a", 10, start + std::chrono::milliseconds(102)).count(), 0);
  // However long it rests, it holds two seconds' worth.
  const auto later = start + std::chrono::hours(1);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(limiter.take("a", 10, later).count(), 0);
  EXPECT_GT(limiter.take("a", 10, later).count(), 0);
}

TEST(RateLimiter, ForgetsFullBucketsFirst) {
  RateLimiter limiter(3);
  const auto start = RateLimiter::Clock::now();
  const auto empty = [&](auto now) { return limiter.take("busy", 0.1, now).count() > 0; };
  EXPECT_FALSE(empty(start));
  EXPECT_TRUE(empty(start));
  const auto soon = start + seconds(1);
  for (int i = 0; i < 100; ++i) {
    limiter.take(std::to_string(i), 1000, soon + i * std::chrono::milliseconds(5));
  }
  EXPECT_TRUE(empty(start + seconds(2)));
}

}  // namespace
}  // namespace cellmap::auth
