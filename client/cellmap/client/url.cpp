#include "cellmap/client/url.hpp"

#include <algorithm>
#include <cctype>
#include <charconv>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

[[noreturn]] void refuse(std::string_view text, const std::string& why) {
  throw Error(ErrorCode::kInvalidArgument,
              "'" + std::string(text) + "' is not a server address: " + why +
                  "; write http://HOST:PORT, for example http://127.0.0.1:8080");
}

int parse_port(std::string_view digits, std::string_view text) {
  int port = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), port);
  if (error != std::errc() || end != digits.data() + digits.size() || port < 1 || port > 65535) {
    refuse(text, "the port must be a number from 1 to 65535");
  }
  return port;
}

bool is_host_character(char c) {
  return std::isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '-' || c == '_';
}

/// Splits "host:port" or "[v6]:port" into `url`.
void parse_authority(std::string_view authority, std::string_view text, ServerUrl& url) {
  std::string_view port;
  if (authority.starts_with('[')) {
    const auto close = authority.find(']');
    if (close == std::string_view::npos)
      refuse(text, "the bracket of the IPv6 address is not closed");
    url.host = authority.substr(1, close - 1);
    port = authority.substr(close + 1);
    if (url.host.find_first_not_of("0123456789abcdefABCDEF:.") != std::string::npos) {
      refuse(text, "the IPv6 address has characters that do not belong there");
    }
  } else {
    const auto colon = authority.find(':');
    url.host = authority.substr(0, colon);
    port = colon == std::string_view::npos ? std::string_view() : authority.substr(colon);
    if (!std::all_of(url.host.begin(), url.host.end(), is_host_character)) {
      refuse(text, "the host has characters that do not belong there");
    }
  }
  if (url.host.empty()) refuse(text, "the host is missing");
  if (port.empty()) return;
  if (port.front() != ':') refuse(text, "':PORT' was expected after the host");
  url.port = parse_port(port.substr(1), text);
}

}  // namespace

ServerUrl parse_server_url(std::string_view text) {
  ServerUrl url;
  std::string_view rest = text;
  if (const auto scheme_end = rest.find("://"); scheme_end != std::string_view::npos) {
    url.scheme = rest.substr(0, scheme_end);
    std::transform(url.scheme.begin(), url.scheme.end(), url.scheme.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    rest.remove_prefix(scheme_end + 3);
  }
  if (url.scheme != "http" && url.scheme != "https") {
    refuse(text, "the scheme must be http or https");
  }
  if (url.scheme == "https") url.port = 443;
  if (rest.find_first_of("?#") != std::string_view::npos) {
    refuse(text, "it must have no query and no fragment");
  }
  if (rest.find('@') != std::string_view::npos) refuse(text, "it must have no user name");
  const auto slash = rest.find('/');
  parse_authority(rest.substr(0, slash), text, url);
  if (slash != std::string_view::npos) url.path_prefix = rest.substr(slash);
  while (url.path_prefix.ends_with('/')) url.path_prefix.pop_back();
  if (std::any_of(url.path_prefix.begin(), url.path_prefix.end(),
                  [](char c) { return c <= ' ' || c >= 0x7f; })) {
    refuse(text, "the path has characters that must be percent-encoded");
  }
  return url;
}

std::string to_string(const ServerUrl& url) {
  const bool v6 = url.host.find(':') != std::string::npos;
  return url.scheme + "://" + (v6 ? "[" + url.host + "]" : url.host) + ":" +
         std::to_string(url.port) + url.path_prefix;
}

std::string percent_encoded(std::string_view text) {
  constexpr std::string_view kHex = "0123456789ABCDEF";
  std::string encoded;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (is_host_character(c) || c == '~') {
      encoded += c;
    } else {
      encoded += {'%', kHex[byte >> 4], kHex[byte & 15]};
    }
  }
  return encoded;
}

}  // namespace cellmap
