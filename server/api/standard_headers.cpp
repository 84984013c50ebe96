#include "server/api/standard_headers.hpp"

#include <algorithm>
#include <cctype>

#include "cellmap/core/error.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

void set_default(Headers& headers, std::string_view name, std::string_view value) {
  if (!headers.get(name)) headers.set(name, value);
}

void keep_private(Headers& headers) {
  std::string value(headers.get("Cache-Control").value_or("private"));
  constexpr std::string_view kPublic = "public";
  if (const auto at = value.find(kPublic); at != value.npos) {
    value.replace(at, kPublic.size(), "private");
  }
  headers.set("Cache-Control", value);
}

bool is_origin(const std::string& text) {
  const auto scheme = text.find("://");
  if (scheme == text.npos || scheme == 0 || scheme + 3 == text.size()) return false;
  return std::ranges::all_of(text.substr(scheme + 3), [](unsigned char c) {
    return std::isalnum(c) || c == '.' || c == '-' || c == ':' || c == '[' || c == ']';
  });
}

}  // namespace

void set_standard_headers(Response& response, const std::string& request_id, bool is_private) {
  Headers& headers = response.headers;
  headers.set("X-Request-Id", request_id);
  headers.set("X-Content-Type-Options", "nosniff");
  set_default(headers, "Content-Security-Policy", "default-src 'none'; frame-ancestors 'none'");
  set_default(headers, "Referrer-Policy", "no-referrer");
  if (is_private) keep_private(headers);
}

CrossOrigin::CrossOrigin(std::vector<std::string> origins) : origins_(std::move(origins)) {
  for (const std::string& origin : origins_) {
    if (origin == "*" || is_origin(origin)) continue;
    throw Error(ErrorCode::kInvalidArgument,
                "Expected an origin such as https://maps.example.org, or *, found " +
                    in_quotes(origin) + ".");
  }
}

std::optional<std::string> CrossOrigin::allowed(const Request& request) const {
  const auto origin = request.headers.get("Origin");
  if (!origin) return std::nullopt;
  for (const std::string& known : origins_) {
    if (known == "*" || known == *origin) return known;
  }
  return std::nullopt;
}

std::optional<Response> CrossOrigin::preflight(const Request& request,
                                               const std::string& methods) const {
  if (request.method != "OPTIONS" || !request.headers.get("Access-Control-Request-Method") ||
      !allowed(request)) {
    return std::nullopt;
  }
  Response response;
  response.status = 204;
  response.headers.set("Access-Control-Allow-Methods", methods);
  response.headers.set("Access-Control-Allow-Headers",
                       "Accept, Authorization, CELLmap-Pose, Content-Encoding, Content-Type, "
                       "If-Match, If-None-Match, If-Range, Last-Event-ID, Range, X-Request-Id");
  response.headers.set("Access-Control-Max-Age", "600");
  return response;
}

void CrossOrigin::allow(const Request& request, Response& response) const {
  if (!is_on()) return;
  response.headers.add("Vary", "Origin");
  const auto origin = allowed(request);
  if (!origin) return;
  response.headers.set("Access-Control-Allow-Origin", *origin);
  response.headers.set("Access-Control-Expose-Headers",
                       "CELLmap-Coarse-Bytes, CELLmap-Created, CELLmap-File-Bytes, CELLmap-Pose, "
                       "CELLmap-Remaining, CELLmap-Revision, Content-Range, ETag, Location, "
                       "Retry-After, X-Request-Id");
}

std::optional<std::string> given_request_id(const Headers& headers) {
  const auto id = headers.get("X-Request-Id");
  const bool good =
      id && !id->empty() && id->size() <= 64 && std::ranges::all_of(*id, [](unsigned char c) {
        return std::isalnum(c) || c == '.' || c == '_' || c == '-';
      });
  return good ? std::optional<std::string>(*id) : std::nullopt;
}

}  // namespace cellmap::server
