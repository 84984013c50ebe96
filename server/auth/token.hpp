#pragma once

#include <chrono>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "cellmap/core/hash.hpp"

namespace cellmap::auth {

/// What a token allows. They stand beside one another: a robot that maps has `map:read` and
/// `map:write`. Only `admin` includes the others.
enum class Scope {
  kMapRead,     ///< "map:read"
  kMapWrite,    ///< "map:write": adds to maps, changes and makes them
  kRelocalise,  ///< "relocalise": asks where a scan was taken, learns nothing else of the map
  kAdmin,       ///< "admin": all of it, and deletes maps
};

std::string_view to_string(Scope scope);
std::optional<Scope> scope_from_string(std::string_view text);

using Time = std::chrono::sys_seconds;

/// Who a secret stands for. The secret itself is known to its owner only.
struct Token {
  std::string name;  ///< for logs: 1 to 64 of A-Z a-z 0-9 . _ -
  ContentHash hash;  ///< SHA-256 of the secret
  std::set<Scope> scopes;
  std::set<std::string> maps;            ///< the only maps it is good for; empty: all
  std::optional<Time> expires;           ///< good before, not at
  std::optional<double> requests_per_s;  ///< instead of the server's limit; 0: none

  bool operator==(const Token&) const = default;

  bool allows(Scope scope) const {
    return scopes.contains(scope) || scopes.contains(Scope::kAdmin);
  }
  bool allows_map(const std::string& map) const { return maps.empty() || maps.contains(map); }
  bool is_expired(Time now) const { return expires && now >= *expires; }
};

/// "cellmap_" and 32 random bytes: nobody guesses it, and scanners for leaked secrets find it.
std::string make_secret();
ContentHash hash_of_secret(std::string_view secret);

/// 1 to 128 of the characters that a bearer token has (RFC 6750, section 2.1).
bool is_secret(std::string_view text);
bool is_token_name(std::string_view text);

/// "2027-01-31T00:00:00Z", UTC.
std::string to_text(Time time);
/// Inverse of `to_text`; a date alone is its midnight. nullopt for anything else.
std::optional<Time> time_from_text(std::string_view text);

}  // namespace cellmap::auth
