#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

#include "cellmap/archive/byte_source.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "server/auth/guard.hpp"

namespace cellmap::server {

/// Header fields in order; names compare without regard to case.
class Headers {
 public:
  void set(std::string_view name, std::string value);  ///< replaces
  void add(std::string_view name, std::string value);
  /// The value, or all values of the name joined by ", " (RFC 9110, 5.3); nullopt where absent.
  std::optional<std::string> get(std::string_view name) const;
  const std::vector<std::pair<std::string, std::string>>& fields() const { return fields_; }

 private:
  std::vector<std::pair<std::string, std::string>> fields_;
};

/// An HTTP request with its whole body, as the front read it, in memory or in a file. `target` is
/// the raw request target.
struct Request {
  std::string method;
  std::string target;
  Headers headers;
  std::string body;
  std::string id;                    ///< names the request in logs and in X-Request-Id
  std::shared_ptr<ByteFile> file{};  ///< the body instead, of a route that takes large ones
  std::string address{};             ///< where it comes from, for limits and the audit log
  /// Who asks, once `Api::refuse` let it pass; `Api::handle` finds out itself where it is not set.
  std::optional<auth::Caller> caller{};
};

/// Bytes that many answers share without copying.
struct SharedBytes {
  std::shared_ptr<const Bytes> bytes;
  std::size_t offset = 0;
  std::size_t length = 0;
};

/// A part of a file, read as it is sent.
struct FileBody {
  std::shared_ptr<ByteSource> file;
  std::uint64_t offset = 0;
  std::uint64_t length = 0;
};

/// A body of unknown length: appends the next piece to `chunk` (nothing: try again), blocks for a
/// few seconds at most, and returns false when it has ended.
using BodyStream = std::function<bool(std::string& chunk)>;

/// An HTTP response. The answer to HEAD keeps the body so that the front can state its length; the
/// front does not send it.
struct Response {
  int status = 200;
  Headers headers;
  std::variant<std::string, SharedBytes, FileBody, BodyStream> body;
};

/// The body's bytes; empty for a stream or a file.
std::string_view body_view(const Response& response);

inline std::span<const std::byte> as_bytes(std::string_view text) {
  return std::as_bytes(std::span(text.data(), text.size()));
}

}  // namespace cellmap::server
