#include "server/api/access.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "cellmap/core/error.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

using auth::Refusal;
using auth::Scope;

struct AccessRow {
  std::string_view method, pattern;
  std::optional<Scope> scope;
};

constexpr std::optional<Scope> kOpen = std::nullopt;
constexpr auto kRead = Scope::kMapRead, kWrite = Scope::kMapWrite;

// Open is what a load balancer or a browser asks for before it could have a token, and what holds
// nothing of any map: state, the viewer's program, the API's description.
constexpr std::array kAccessTable{
    AccessRow{"GET", "/", kOpen},
    AccessRow{"GET", "/assets/{file}", kOpen},
    AccessRow{"GET", "/api", kOpen},
    AccessRow{"GET", "/api/", kOpen},
    AccessRow{"GET", "/healthz", kOpen},
    AccessRow{"GET", "/readyz", kOpen},
    AccessRow{"GET", "/openapi.yaml", kOpen},
    AccessRow{"GET", "/metrics", kRead},
    AccessRow{"GET", "/v1/backup", Scope::kAdmin},
    AccessRow{"GET", "/v1/maps", kRead},
    AccessRow{"POST", "/v1/maps", kWrite},
    AccessRow{"GET", "/v1/maps/{map}", kRead},
    AccessRow{"DELETE", "/v1/maps/{map}", Scope::kAdmin},
    AccessRow{"GET", "/v1/maps/{map}/cells", kRead},
    AccessRow{"GET", "/v1/maps/{map}/cells/{cell}", kRead},
    AccessRow{"PUT", "/v1/maps/{map}/cells/{cell}", kWrite},
    AccessRow{"POST", "/v1/maps/{map}/cells:batch", kRead},
    AccessRow{"GET", "/v1/maps/{map}/pose-graph", kRead},
    AccessRow{"GET", "/v1/maps/{map}/changes", kRead},
    AccessRow{"GET", "/v1/maps/{map}/events", kRead},
    AccessRow{"GET", "/v1/maps/{map}/trajectory", kRead},
    AccessRow{"POST", "/v1/maps/{map}/relocalise", Scope::kRelocalise},
    AccessRow{"POST", "/v1/maps/{map}/places:search", Scope::kRelocalise},
    AccessRow{"GET", "/v1/maps/{map}/diff", kRead},
    AccessRow{"GET", "/v1/maps/{map}/loops", kRead},
    AccessRow{"POST", "/v1/maps/{map}/loops", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/loops/{loop}", kRead},
    AccessRow{"PATCH", "/v1/maps/{map}/loops/{loop}", kWrite},
    AccessRow{"DELETE", "/v1/maps/{map}/loops/{loop}", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/georeference", kRead},
    AccessRow{"PUT", "/v1/maps/{map}/georeference", kWrite},
    AccessRow{"DELETE", "/v1/maps/{map}/georeference", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/comparison", kRead},
    AccessRow{"PUT", "/v1/maps/{map}/comparison", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/archive", kRead},
    AccessRow{"PUT", "/v1/maps/{map}/archive", kWrite},
    AccessRow{"POST", "/v1/maps/{map}/convert", Scope::kAdmin},
    AccessRow{"POST", "/v1/maps/{map}/merge", kWrite},
    AccessRow{"POST", "/v1/maps/{map}/split", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/sessions", kRead},
    AccessRow{"POST", "/v1/maps/{map}/sessions", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/sessions/{session}", kRead},
    AccessRow{"DELETE", "/v1/maps/{map}/sessions/{session}", kWrite},
    AccessRow{"POST", "/v1/maps/{map}/sessions/{session}/cells:lacking", kWrite},
    AccessRow{"PUT", "/v1/maps/{map}/sessions/{session}/cells/{hash}", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/sessions/{session}/scans", kRead},
    AccessRow{"POST", "/v1/maps/{map}/sessions/{session}/scans", kWrite},
    AccessRow{"POST", "/v1/maps/{map}/sessions/{session}/scans:complete", kWrite},
    AccessRow{"GET", "/v1/maps/{map}/jobs", kRead},
    AccessRow{"POST", "/v1/maps/{map}/jobs", kWrite},
    AccessRow{"GET", "/v1/jobs/{job}", kRead},
    AccessRow{"DELETE", "/v1/jobs/{job}", kWrite},
    AccessRow{"GET", "/v1/jobs/{job}/events", kRead},
    AccessRow{"PUT", "/v1/jobs/{job}/scans/{index}", kWrite},
    AccessRow{"POST", "/v1/jobs/{job}/complete", kWrite},
};

Response unauthenticated(const std::string& detail, const std::string& error) {
  Response response = problem(ErrorCode::kUnauthenticated, detail);
  response.headers.set("WWW-Authenticate", "Bearer realm=\"cellmap\"" + error);
  return response;
}

Response forbidden(const std::string& detail, const std::string& scope) {
  Response response = problem(ErrorCode::kPermissionDenied, detail);
  response.headers.set("WWW-Authenticate",
                       "Bearer realm=\"cellmap\", error=\"insufficient_scope\"" + scope);
  return response;
}

Response too_many(double wait_s) {
  const long seconds = std::max(1L, std::lround(std::ceil(wait_s)));
  Response response =
      problem(ErrorCode::kRateLimited, "There were too many requests; send the next one in " +
                                           std::to_string(seconds) + " s.");
  response.headers.set("Retry-After", std::to_string(seconds));
  return response;
}

}  // namespace

std::optional<Scope> scope_of(std::string_view method, std::string_view pattern) {
  for (const AccessRow& row : kAccessTable) {
    if (row.method == method && row.pattern == pattern) return row.scope;
  }
  throw Error(ErrorCode::kInternal, "The table of scopes lacks " + std::string(method) + " " +
                                        std::string(pattern) + ".");
}

bool is_write(const std::optional<Scope>& scope) {
  return scope == Scope::kMapWrite || scope == Scope::kAdmin;
}

Response refused(const auth::Verdict& verdict, const auth::Demand& demand) {
  switch (verdict.refusal) {
    case Refusal::kNoToken:
      return unauthenticated(
          "This server asks for a token: send 'Authorization: Bearer TOKEN', "
          "or give the command line --token-file FILE or CELLMAP_TOKEN.",
          "");
    case Refusal::kExpired:
      return unauthenticated("The token has expired; ask for a new one.",
                             ", error=\"invalid_token\", error_description=\"expired\"");
    case Refusal::kScope: {
      const std::string scope(to_string(demand.scope.value()));
      return forbidden("This needs a token with the scope " + scope + ".",
                       ", scope=\"" + scope + "\"");
    }
    case Refusal::kMap:
      return map_refused(demand.map.value_or(""));
    case Refusal::kTooMany:
      return too_many(verdict.wait_s);
    case Refusal::kNone:
    case Refusal::kUnknownToken:
      break;
  }
  return unauthenticated("The token is unknown, malformed or revoked.",
                         ", error=\"invalid_token\"");
}

Response map_refused(const std::string& map) {
  return forbidden("The token is not good for the map " + in_quotes(map) + ".", "");
}

}  // namespace cellmap::server
