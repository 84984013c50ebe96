#pragma once

#include <cstddef>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/auth/rate_limiter.hpp"
#include "server/auth/token.hpp"

namespace cellmap::auth {

struct GuardOptions {
  std::filesystem::path tokens;  ///< as token_file.hpp has it; empty: nobody is asked who they are
  double requests_per_s = 0;     ///< of one token, or without tokens of one address; 0: no limit
  double failures_per_s = 5;     ///< wrong tokens of one address
};

/// Who asks. Without tokens an address, which may do everything.
struct Caller {
  std::string name;                    ///< of the token; "" without one
  std::shared_ptr<const Token> token;  ///< null without one

  bool may_use(const std::string& map) const { return !token || token->allows_map(map); }
};

/// What a request asks for.
struct Demand {
  std::optional<Scope> scope;        ///< none: open to everyone
  std::optional<std::string> map;    ///< that it is about
  std::optional<std::string> field;  ///< the value of its Authorization
  std::string address;               ///< where it comes from
  /// Of what other servers ask on behalf of a caller: how many they are. He was charged where he
  /// asked; here it counts apart from his own requests, so many times as many of them.
  std::size_t for_servers = 0;
};

enum class Refusal {
  kNone,
  kNoToken,       ///< no bearer token was sent
  kUnknownToken,  ///< malformed, unknown or revoked
  kExpired,
  kScope,
  kMap,
  kTooMany,  ///< requests, or wrong tokens
};

struct Verdict {
  Refusal refusal = Refusal::kNone;
  Caller caller;
  double wait_s = 0;  ///< for kTooMany
};

/// Decides who may do what. Thread safe.
class Guard {
 public:
  /// Reads the tokens. Throws as `read_token_file`; Error{kInvalidArgument} for a negative rate.
  explicit Guard(GuardOptions options);

  bool asks_for_tokens() const { return !options_.tokens.empty(); }
  /// Reads the token file again. Where it throws, the tokens of before go on.
  void reload();
  std::size_t token_count() const;

  Verdict admit(const Demand& demand);

  /// Whether a token that was admitted still would be: for answers that take long.
  bool still_knows(const Token& token) const;

 private:
  using Tokens = std::vector<std::shared_ptr<const Token>>;
  std::shared_ptr<const Token> find(std::string_view secret) const;
  std::shared_ptr<const Tokens> tokens() const;
  Verdict too_many(const Demand& demand, const std::string& key, double per_second, Caller caller);
  Verdict failed(Refusal refusal, const std::string& address);

  const GuardOptions options_;
  RateLimiter requests_, failures_;
  mutable std::mutex mutex_;
  std::shared_ptr<const Tokens> tokens_;
};

}  // namespace cellmap::auth
