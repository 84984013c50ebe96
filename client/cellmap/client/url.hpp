#pragma once

#include <string>
#include <string_view>

namespace cellmap {

/// Where a server is.
struct ServerUrl {
  std::string scheme = "http";  ///< "http" or "https"
  std::string host;             ///< name or address; an IPv6 address without its brackets
  int port = 80;                ///< 1 to 65535
  std::string path_prefix;      ///< "" or "/some/prefix" without a final slash (a reverse proxy's)
  bool operator==(const ServerUrl&) const = default;
};

/// Reads "http://host:port/prefix". The scheme may be left out (http), the port defaults to 80 or
/// 443, an IPv6 address stands in brackets. Throws Error{kInvalidArgument} saying which part is
/// wrong: another scheme, no host, a bad port, user names, queries and fragments.
ServerUrl parse_server_url(std::string_view text);

/// "http://host:port/prefix", the port always given.
std::string to_string(const ServerUrl& url);

/// Percent-encodes everything but RFC 3986 unreserved characters: fit for one path segment or one
/// query value.
std::string percent_encoded(std::string_view text);

}  // namespace cellmap
