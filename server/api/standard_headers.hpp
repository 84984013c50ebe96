#pragma once

#include <string>
#include <vector>

#include "server/api/message.hpp"

namespace cellmap::server {

/// Fields that every answer has: its request's id, and what keeps a browser from taking an answer
/// for something else, framing it or telling others of it. `is_private`: only its caller may keep
/// it, no shared cache.
void set_standard_headers(Response& response, const std::string& request_id, bool is_private);

/// Cross-origin requests of browsers (the Fetch standard, "CORS protocol"): off unless there are
/// origins; "*" is any. Credentials other than the token that a page sends itself are never asked
/// for.
class CrossOrigin {
 public:
  /// Throws Error{kInvalidArgument} for what is neither "*" nor "scheme://host[:port]".
  explicit CrossOrigin(std::vector<std::string> origins);

  bool is_on() const { return !origins_.empty(); }
  /// The answer to OPTIONS, where it asks for one (a preflight) that is allowed.
  std::optional<Response> preflight(const Request& request, const std::string& methods) const;
  /// Lets the page read the answer.
  void allow(const Request& request, Response& response) const;

 private:
  std::optional<std::string> allowed(const Request& request) const;
  std::vector<std::string> origins_;
};

/// The id that a client or proxy gave its request (X-Request-Id) where it is 1 to 64 of letters,
/// digits, '.', '_', '-'; nullopt for anything else, which must not get into logs.
std::optional<std::string> given_request_id(const Headers& headers);

}  // namespace cellmap::server
