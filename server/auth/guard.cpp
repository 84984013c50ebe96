#include "server/auth/guard.hpp"

#include <cmath>

#include "cellmap/core/error.hpp"
#include "cellmap/core/secret.hpp"
#include "server/auth/token_file.hpp"

namespace cellmap::auth {
namespace {

Time now() { return std::chrono::floor<std::chrono::seconds>(std::chrono::system_clock::now()); }

/// The secret of "Bearer SECRET" (RFC 6750, section 2.1); nullopt for anything else.
std::optional<std::string_view> secret_of(std::string_view field) {
  constexpr std::string_view kScheme = "bearer ";
  if (field.size() <= kScheme.size()) return std::nullopt;
  for (std::size_t i = 0; i < kScheme.size(); ++i) {
    const char c = field[i];
    if ((c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c) != kScheme[i]) return std::nullopt;
  }
  const auto begin = field.find_first_not_of(' ', kScheme.size());
  if (begin == field.npos || !is_secret(field.substr(begin))) return std::nullopt;
  return field.substr(begin);
}

}  // namespace

Guard::Guard(GuardOptions options) : options_(std::move(options)) {
  const bool good = options_.requests_per_s >= 0 && options_.failures_per_s > 0 &&
                    std::isfinite(options_.requests_per_s + options_.failures_per_s);
  if (!good) {
    throw Error(ErrorCode::kInvalidArgument,
                "Expected a rate limit of 0 (none) or more requests a second.");
  }
  tokens_ = std::make_shared<const Tokens>();
  reload();
}

void Guard::reload() {
  if (!asks_for_tokens()) return;
  auto loaded = std::make_shared<Tokens>();
  for (Token& token : read_token_file(options_.tokens)) {
    loaded->push_back(std::make_shared<const Token>(std::move(token)));
  }
  const std::lock_guard lock(mutex_);
  tokens_ = std::move(loaded);
}

std::shared_ptr<const Guard::Tokens> Guard::tokens() const {
  const std::lock_guard lock(mutex_);
  return tokens_;
}

std::size_t Guard::token_count() const { return tokens()->size(); }

/// Looks at all of them, so that time says nothing of which one it was.
std::shared_ptr<const Token> Guard::find(std::string_view secret) const {
  const ContentHash hash = hash_of_secret(secret);
  std::shared_ptr<const Token> found;
  const auto all = tokens();
  for (const auto& token : *all) {
    if (equal_in_constant_time(token->hash, hash)) found = token;
  }
  return found;
}

bool Guard::still_knows(const Token& token) const {
  if (token.is_expired(now())) return false;
  const auto all = tokens();
  for (const auto& other : *all) {
    if (*other == token) return true;
  }
  return false;
}

Verdict Guard::too_many(const Demand& demand, const std::string& key, double per_second,
                        Caller caller) {
  if (per_second <= 0) return {Refusal::kNone, std::move(caller)};
  const bool own = demand.for_servers == 0;
  const auto wait =
      requests_.take(own ? key : "for servers " + key,
                     own ? per_second : per_second * static_cast<double>(demand.for_servers),
                     RateLimiter::Clock::now());
  return {wait.count() > 0 ? Refusal::kTooMany : Refusal::kNone, std::move(caller), wait.count()};
}

Verdict Guard::failed(Refusal refusal, const std::string& address) {
  const auto wait = failures_.take(address, options_.failures_per_s, RateLimiter::Clock::now());
  return {wait.count() > 0 ? Refusal::kTooMany : refusal, {}, wait.count()};
}

Verdict Guard::admit(const Demand& demand) {
  if (!demand.scope) return {};
  if (!asks_for_tokens()) return too_many(demand, demand.address, options_.requests_per_s, {});
  if (!demand.field) return {Refusal::kNoToken, {}, 0};  // no guess
  const auto secret = secret_of(*demand.field);
  auto token = secret ? find(*secret) : nullptr;
  if (!token) return failed(Refusal::kUnknownToken, demand.address);
  if (token->is_expired(now())) return failed(Refusal::kExpired, demand.address);
  Verdict verdict =
      too_many(demand, "token " + token->name,
               token->requests_per_s.value_or(options_.requests_per_s), {token->name, token});
  if (verdict.refusal != Refusal::kNone) return verdict;
  if (!token->allows(*demand.scope)) verdict.refusal = Refusal::kScope;
  if (demand.map && !token->allows_map(*demand.map)) verdict.refusal = Refusal::kMap;
  return verdict;
}

}  // namespace cellmap::auth
