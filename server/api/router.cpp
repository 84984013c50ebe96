#include "server/api/router.hpp"

#include <algorithm>
#include <span>
#include <stdexcept>

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

/// Up to `segments.size()`; how many there are.
std::size_t read_segments(std::string_view path, std::span<std::string_view> segments) {
  if (path.starts_with('/')) path.remove_prefix(1);
  for (std::size_t count = 0;; ++count) {
    const auto slash = path.find('/');
    if (count < segments.size()) segments[count] = path.substr(0, slash);
    if (slash == std::string_view::npos) return count + 1;
    path.remove_prefix(slash + 1);
  }
}

bool is_parameter(std::string_view segment) { return segment.starts_with('{'); }

/// Whatever the parameters are. From the end, since most paths begin alike.
bool has_segments(std::span<const std::string> pattern, std::span<const std::string_view> path) {
  for (std::size_t i = pattern.size(); i-- > 0;) {
    if (!is_parameter(pattern[i]) && pattern[i] != path[i]) return false;
  }
  return true;
}

/// HEAD takes GET's.
bool takes(const Route& route, std::string_view method) {
  return route.method == method || (route.method == "GET" && method == "HEAD");
}

std::optional<PathParameters> match(std::span<const std::string> pattern,
                                    std::span<const std::string_view> path) {
  if (!has_segments(pattern, path)) return std::nullopt;
  PathParameters parameters;
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    if (!is_parameter(pattern[i])) continue;
    auto value = percent_decoded(path[i]);
    if (!value || value->empty()) return std::nullopt;
    const std::string_view name = pattern[i];
    parameters.add(name.substr(1, name.size() - 2), *std::move(value));
  }
  return parameters;
}

}  // namespace

const std::string* PathParameters::find(std::string_view name) const {
  for (const auto& [known, value] : parameters_) {
    if (known == name) return &value;
  }
  return nullptr;
}

const std::string& PathParameters::at(std::string_view name) const {
  if (const std::string* value = find(name)) return *value;
  throw std::out_of_range("no path parameter " + std::string(name));
}

std::uint32_t Call::path_id(std::string_view name) const {
  const auto value = parse_unsigned(path(name));
  if (!value || *value > UINT32_MAX) {
    refuse_target("A " + std::string(name) +
                  " is named by an integer from 0 to 4294967295, found " + in_quotes(path(name)) +
                  ".");
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
  std::array<std::string_view, kMaxSegments> segments;
  const std::size_t count = read_segments(route.pattern, segments);
  patterns_.at(count).push_back({{segments.begin(), segments.begin() + count}, routes_.size()});
  routes_.push_back(std::move(route));
}

Router::Match Router::find(std::string_view method, std::string_view path) const {
  std::array<std::string_view, kMaxSegments> segments;
  const std::size_t count = read_segments(path, segments);
  Match result;
  if (count > kMaxSegments) return result;
  for (const Pattern& pattern : patterns_[count]) {
    auto parameters = match(pattern.segments, std::span(segments).first(count));
    if (!parameters) continue;
    const Route& route = routes_[pattern.route];
    if (takes(route, method)) return {&route, *std::move(parameters), {}};
    const std::string name = route.method == "GET" ? "GET, HEAD" : route.method;
    result.allow += (result.allow.empty() ? "" : ", ") + name;
  }
  return result;
}

bool Router::may_wait(std::string_view method, std::string_view path) const {
  std::array<std::string_view, kMaxSegments> segments;
  const std::size_t count = read_segments(path, segments);
  if (count > kMaxSegments) return false;
  return std::ranges::any_of(patterns_[count], [&](const Pattern& pattern) {
    const Route& route = routes_[pattern.route];
    return route.waits && takes(route, method) &&
           has_segments(pattern.segments, std::span(segments).first(count));
  });
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
