#pragma once

#include <fstream>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "server/auth/token_file.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {

using auth::Scope;

/// An API that asks for tokens and keeps an audit log.
class GuardedApiTest : public ApiTest {
 protected:
  GuardedApiTest() {
    make_map();
    restart({});
  }
  ~GuardedApiTest() override { stop(); }

  /// Tokens that were added until then.
  void restart(auth::GuardOptions limits) {
    stop();
    admin_ = admin_.empty() ? add_token("root", {Scope::kAdmin}) : admin_;
    limits.tokens = folder_ / "tokens";
    guard_ = std::make_unique<auth::Guard>(limits);
    audit_ = std::make_unique<AuditLog>(folder_ / "audit");
    ApiOptions guarded = options();
    guarded.guard = guard_.get();
    guarded.audit = audit_.get();
    guarded.allow_origins = origins_;
    start(std::move(guarded));
  }

  /// Its secret. Known to the API after `guard_->reload()`.
  std::string add_token(const std::string& name, std::set<Scope> scopes,
                        std::set<std::string> maps = {}, std::optional<auth::Time> expires = {}) {
    const std::string secret = auth::make_secret();
    auth::add_token(
        folder_ / "tokens",
        {name, auth::hash_of_secret(secret), std::move(scopes), std::move(maps), expires, {}});
    if (guard_) guard_->reload();
    return secret;
  }

  static Headed bearer(const std::string& secret) { return {"Authorization", "Bearer " + secret}; }
  static Headed json_body() { return {"Content-Type", "application/json"}; }

  std::vector<Json> audited() const {
    std::vector<Json> lines;
    std::ifstream input(folder_ / "audit");
    for (std::string line; std::getline(input, line);) lines.push_back(Json::parse(line));
    return lines;
  }

  std::string admin_;
  std::vector<std::string> origins_;
  std::unique_ptr<auth::Guard> guard_;
  std::unique_ptr<AuditLog> audit_;
};

}  // namespace cellmap::server::test
