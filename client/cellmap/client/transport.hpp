#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>

#include "cellmap/client/client.hpp"

namespace cellmap::client {

/// Header names in lower case.
using Headers = std::map<std::string, std::string>;

/// A body that is read while it is sent.
struct LargeBody {
  std::uint64_t length = 0;
  /// At least one byte and at most so many, from an offset below `length`; empty: it failed.
  std::function<std::string(std::uint64_t, std::size_t)> read;
};

struct HttpRequest {
  std::string method = "GET";
  std::string path;  ///< below the server's prefix, with query, percent-encoded
  Headers headers;
  std::string body;
  std::size_t max_answer_bytes = 64u << 20;  ///< a longer body is Error{kTooLarge}
  bool idempotent = true;  ///< may be sent again where it is not known whether it arrived
  std::optional<LargeBody> large_body{};  ///< instead of `body`
};

struct HttpResponse {
  int status = 0;
  Headers headers;
  std::string body;  ///< decompressed where the server sent zstd

  std::string header(const std::string& lower_case_name) const;  ///< "" where it is missing
};

/// An endless answer.
struct StreamRequest {
  std::string path;
  Headers headers;
  /// Silence after which the connection counts as broken; 0: `ClientOptions::read_timeout`.
  std::chrono::milliseconds max_silence{0};
};

/// One keep-alive connection to a server, with retries and bounded answers. Not thread safe.
class Transport {
 public:
  explicit Transport(const ClientOptions& options);
  ~Transport();

  const ServerUrl& url() const { return url_; }

  /// Any answer with a status below 400, or 409 where `HttpRequest` is prepared for it through
  /// `accept_conflict`. Throws the problem's Error for others, Error{kUnavailable} where no
  /// connection can be had, Error{kIo} where one breaks.
  HttpResponse perform(const HttpRequest& request, bool accept_conflict = false);

  /// GETs an endless answer piece by piece until `receive` returns false, the server ends it or a
  /// stop is requested. One attempt, on a connection of its own. Returns false where the connection
  /// failed or the server refused. What `receive` throws is thrown on.
  bool stream(const StreamRequest& request, const std::function<bool(std::string_view)>& receive,
              std::stop_token stop);

  Traffic traffic() const { return traffic_; }

 private:
  struct Attempt;
  Attempt attempt(const HttpRequest& request);

  struct Impl;
  ClientOptions options_;
  ServerUrl url_;
  Traffic traffic_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap::client
