#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "server/api/message.hpp"
#include "server/auth/guard.hpp"

namespace cellmap::server {

/// What a route asks of who calls it. nullopt: nothing, it is open to everyone. This is the one
/// table of it; schema/openapi.yaml says the same (a test compares them). Throws
/// Error{kInternal} for a route that is not in it, so that none can be forgotten.
std::optional<auth::Scope> scope_of(std::string_view method, std::string_view pattern);

/// True for what the audit log is told of.
bool is_write(const std::optional<auth::Scope>& scope);

/// The answer to a request that may not go on: 401 with WWW-Authenticate, 403 or 429 with
/// Retry-After.
Response refused(const auth::Verdict& verdict, const auth::Demand& demand);

/// 403 for a map that only the body of a request named.
Response map_refused(const std::string& map);

}  // namespace cellmap::server
