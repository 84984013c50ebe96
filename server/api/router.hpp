#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "cellmap/core/id.hpp"
#include "server/api/json_io.hpp"
#include "server/api/message.hpp"

namespace cellmap::server {

/// The decoded parameters of a path, which are few.
class PathParameters {
 public:
  /// `name` outlives this: it is of a route's pattern.
  void add(std::string_view name, std::string value) {
    parameters_.emplace_back(name, std::move(value));
  }
  /// Null where the path has none of this name.
  const std::string* find(std::string_view name) const;
  /// Throws std::out_of_range where the path has none, which is a fault of the route.
  const std::string& at(std::string_view name) const;

 private:
  std::vector<std::pair<std::string_view, std::string>> parameters_;
};

/// A request on its way to a handler: path parameters and query are decoded, the body is as it
/// came. The readers throw Error{kInvalidArgument}, {kUnsupported} or {kTooLarge} with what was
/// expected.
class Call {
 public:
  /// All of them outlive the call.
  Call(const Request& request, const auth::Caller& caller, const PathParameters& path,
       const std::map<std::string, std::string>& query)
      : request_(request), caller_(caller), path_(path), query_(query) {}

  const std::string& method() const { return request_.method; }
  const std::string& request_id() const { return request_.id; }
  const std::string& address() const { return request_.address; }  ///< where it comes from
  std::optional<std::string_view> header(std::string_view name) const {
    return request_.headers.get(name);
  }

  /// Whether the caller's token is good for a map. The one in the path was checked already.
  bool may_use(const std::string& map) const { return caller_.may_use(map); }

  const std::string& path(std::string_view name) const { return path_.at(name); }
  std::uint32_t path_id(std::string_view name) const;

  std::optional<std::string> query(const std::string& name) const;
  std::optional<std::uint64_t> query_integer(const std::string& name, std::uint64_t min,
                                             std::uint64_t max) const;
  std::optional<double> query_number(const std::string& name, double min, double max) const;
  std::optional<std::vector<double>> query_numbers(const std::string& name,
                                                   std::size_t count) const;

  /// The media type of the body, which must be one of these.
  std::string content_type(const std::vector<std::string>& expected) const;
  /// The body as JSON (Content-Type application/json).
  Json json() const;
  /// The body, decompressed where its Content-Encoding is zstd, at most `max_size` bytes.
  std::string content(std::size_t max_size) const;
  /// The body of a route that takes large ones; without Content-Encoding only.
  std::shared_ptr<ByteFile> file() const;

 private:
  const Request& request_;
  const auth::Caller& caller_;
  const PathParameters& path_;
  const std::map<std::string, std::string>& query_;
};

using Handler = std::function<Response(const Call&)>;

/// One method of one path.
struct Route {
  std::string method;
  std::string pattern;             ///< "/v1/maps/{map}/cells": a segment in braces is a parameter
  std::vector<std::string> query;  ///< names it knows; where it knows some, others are refused
  std::size_t max_body = 0;        ///< bytes, as sent
  std::vector<std::string_view>
      types;  ///< media types of its answer; empty: no negotiation (or its own)
  Handler handler;
  bool waits = false;         ///< a GET that takes long or waits for something to happen
  bool body_in_file = false;  ///< bodies are large: the front puts them into a file, not in memory
  std::optional<auth::Scope> scope{};  ///< what it asks of its caller; `add` looks it up
  bool for_servers = false;            ///< other servers ask it on behalf of their callers
};

/// Routes of the API in order; the first that fits wins.
class Router {
 public:
  /// Throws as `scope_of` for a route of which nobody said who may call it.
  void add(Route route);

  struct Match {
    const Route* route = nullptr;  ///< null: no route
    PathParameters path;
    std::string allow;  ///< the methods that the path has; empty: no such path
  };
  /// HEAD finds GET. The match is valid as long as the router.
  Match find(std::string_view method, std::string_view path) const;
  /// Whether a route `waits` that the path could be of; without looking at its parameters.
  bool may_wait(std::string_view method, std::string_view path) const;

  const std::vector<Route>& routes() const { return routes_; }

 private:
  struct Pattern {
    std::vector<std::string> segments;
    std::size_t route = 0;  ///< whose it is
  };
  static constexpr std::size_t kMaxSegments = 12;

  std::vector<Route> routes_;
  std::array<std::vector<Pattern>, kMaxSegments + 1> patterns_;  ///< by the number of segments
};

/// The path (still percent-encoded) and the decoded query of a request target. Throws
/// Error{kInvalidArgument} for broken escapes and for a name that comes twice.
struct Target {
  std::string_view path;
  std::map<std::string, std::string> query;
};
Target parse_target(std::string_view target);

}  // namespace cellmap::server
