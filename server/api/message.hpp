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

/// Header fields in order, kept as one text as it is sent; names compare without regard to case.
/// What is returned is valid until the next change.
class Headers {
 public:
  struct Field {
    std::string_view name, value;
  };

  /// Replaces. `value` must not be of these headers.
  void set(std::string_view name, std::string_view value);
  /// Where there is a value already, both joined by ", " (RFC 9110, 5.3).
  void add(std::string_view name, std::string_view value);
  std::optional<std::string_view> get(std::string_view name) const&;
  /// Of headers that are gone after this.
  std::optional<std::string> get(std::string_view name) && {
    const auto value = std::as_const(*this).get(name);
    return value ? std::optional<std::string>(*value) : std::nullopt;
  }
  std::vector<Field> fields() const;
  /// "Name: value\r\n" for each.
  std::string_view text() const { return text_; }

 private:
  struct Place {
    std::size_t begin = 0, name_size = 0, value_size = 0;
  };
  std::size_t find(std::string_view name) const;
  Field at(const Place& place) const;
  void append(std::string_view name, std::string_view value);

  std::string text_;
  std::vector<Place> places_;  ///< of the fields in the text
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
