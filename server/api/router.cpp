#include "server/api/router.hpp"

#include <algorithm>
#include <span>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "server/api/access.hpp"
#include "server/api/conditions.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

[[noreturn]] void refuse_target(const std::string& message) {
  throw Error(ErrorCode::kInvalidArgument, message);
}

std::string decoded_or_throw(std::string_view text) {
  auto decoded = percent_decoded(text);
  if (!decoded) refuse_target("The request target holds a broken escape: " + in_quotes(text) + ".");
  return *std::move(decoded);
}

std::vector<std::string_view> segments_of(std::string_view path) {
  if (path.starts_with('/')) path.remove_prefix(1);
  std::vector<std::string_view> segments;
  segments.reserve(8);
  for (;;) {
    const auto slash = path.find('/');
    segments.push_back(path.substr(0, slash));
    if (slash == std::string_view::npos) return segments;
    path.remove_prefix(slash + 1);
  }
}

bool is_parameter(std::string_view segment) { return segment.starts_with('{'); }

/// Whatever the parameters are.
bool has_segments(std::span<const std::string> pattern, std::span<const std::string_view> path) {
  return std::ranges::equal(pattern, path, [](std::string_view expected, std::string_view found) {
    return is_parameter(expected) || expected == found;
  });
}

std::optional<std::map<std::string, std::string>> match(std::span<const std::string> pattern,
                                                        std::span<const std::string_view> path) {
  if (!has_segments(pattern, path)) return std::nullopt;
  std::map<std::string, std::string> parameters;
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    if (!is_parameter(pattern[i])) continue;
    auto value = percent_decoded(path[i]);
    if (!value || value->empty()) return std::nullopt;
    parameters.emplace(pattern[i].substr(1, pattern[i].size() - 2), *std::move(value));
  }
  return parameters;
}

}  // namespace

std::uint32_t Call::path_id(const std::string& name) const {
  const auto value = parse_unsigned(path(name));
  if (!value || *value > UINT32_MAX) {
    refuse_target("A " + name + " is named by an integer from 0 to 4294967295, found " +
                  in_quotes(path(name)) + ".");
  }
  return static_cast<std::uint32_t>(*value);
}

std::optional<std::string> Call::query(const std::string& name) const {
  const auto found = query_.find(name);
  return found == query_.end() ? std::nullopt : std::optional(found->second);
}

std::optional<std::uint64_t> Call::query_integer(const std::string& name, std::uint64_t min,
                                                 std::uint64_t max) const {
  const auto text = query(name);
  if (!text) return std::nullopt;
  const auto value = parse_unsigned(*text);
  if (!value || *value < min || *value > max) {
    refuse_target("Expected '" + name + "' to be an integer from " + std::to_string(min) + " to " +
                  std::to_string(max) + ", found " + in_quotes(*text) + ".");
  }
  return value;
}

std::optional<double> Call::query_number(const std::string& name, double min, double max) const {
  const auto text = query(name);
  if (!text) return std::nullopt;
  const auto value = parse_number(*text);
  if (!value || *value < min || *value > max) {
    refuse_target("Expected '" + name + "' to be a number from " + std::to_string(min) + " to " +
                  std::to_string(max) + ", found " + in_quotes(*text) + ".");
  }
  return value;
}

std::optional<std::vector<double>> Call::query_numbers(const std::string& name,
                                                       std::size_t count) const {
  const auto text = query(name);
  if (!text) return std::nullopt;
  return parse_numbers(*text, ',', count, "'" + name + "'");
}

std::string Call::content_type(const std::vector<std::string>& expected) const {
  const auto type = media_type(header("Content-Type").value_or(""));
  std::string list;
  for (const auto& name : expected) {
    if (type == name) return type;
    list += (list.empty() ? "" : " or ") + name;
  }
  throw Error(ErrorCode::kUnsupported,
              "Expected a body of Content-Type " + list + ", found " + in_quotes(type) + ".");
}

Json Call::json() const {
  content_type({"application/json"});
  if (header("Content-Encoding").value_or("identity") != "identity") {
    throw Error(ErrorCode::kUnsupported, "JSON bodies are read without Content-Encoding only.");
  }
  return parse_json(request_.body);
}

std::string Call::content(std::size_t max_size) const {
  const auto coding = header("Content-Encoding").value_or("identity");
  if (equal_no_case(coding, "identity")) return request_.body;
  if (!equal_no_case(coding, "zstd")) {
    throw Error(
        ErrorCode::kUnsupported,
        "Bodies are read with Content-Encoding zstd or none, not " + in_quotes(coding) + ".");
  }
  const Bytes bytes = zstd_decompress(as_bytes(request_.body), max_size);
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

std::shared_ptr<ByteFile> Call::file() const {
  if (!equal_no_case(header("Content-Encoding").value_or("identity"), "identity")) {
    throw Error(ErrorCode::kUnsupported, "Such bodies are read without Content-Encoding only.");
  }
  if (request_.file) return request_.file;
  const auto bytes = as_bytes(request_.body);
  return std::make_shared<MemoryFile>(Bytes(bytes.begin(), bytes.end()));
}

void Router::add(Route route) {
  route.scope = scope_of(route.method, route.pattern);
  const auto segments = segments_of(route.pattern);
  segments_.emplace_back(segments.begin(), segments.end());
  routes_.push_back(std::move(route));
}

Router::Match Router::find(std::string_view method, std::string_view path) const {
  Match result;
  const auto segments = segments_of(path);
  for (std::size_t i = 0; i < routes_.size(); ++i) {
    auto parameters = match(segments_[i], segments);
    if (!parameters) continue;
    const Route& route = routes_[i];
    const bool fits = route.method == method || (route.method == "GET" && method == "HEAD");
    if (fits) return {&route, *std::move(parameters), {}};
    const std::string name = route.method == "GET" ? "GET, HEAD" : route.method;
    result.allow += (result.allow.empty() ? "" : ", ") + name;
  }
  return result;
}

Target parse_target(std::string_view target) {
  target = target.substr(0, target.find('#'));
  const auto mark = target.find('?');
  Target result{target.substr(0, mark), {}};
  if (mark == std::string_view::npos) return result;
  for (const auto pair : split(target.substr(mark + 1), '&')) {
    if (pair.empty()) continue;
    const auto equals = pair.find('=');
    auto name = decoded_or_throw(pair.substr(0, equals));
    std::string value;
    if (equals != std::string_view::npos) {
      std::string plus_as_space(pair.substr(equals + 1));
      for (char& c : plus_as_space) c = c == '+' ? ' ' : c;
      value = decoded_or_throw(plus_as_space);
    }
    if (!result.query.emplace(name, std::move(value)).second) {
      refuse_target("The query names " + in_quotes(name) + " twice.");
    }
  }
  return result;
}

}  // namespace cellmap::server
