#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "server/api/message.hpp"

namespace cellmap::server {

struct HeadLimits {
  std::size_t max_bytes = 16u << 10;  ///< request line and header fields
  std::size_t max_target_bytes = 8u << 10;
  std::size_t max_fields = 100;
};

/// What the head of an HTTP/1.1 request says of what follows it. Views into the bytes.
struct RequestHead {
  std::size_t size = 0;  ///< bytes, the empty line included
  std::string_view method, target;
  std::uint64_t content_length = 0;
  bool chunked = false;
  bool is_http_1_0 = false;
  bool keep = true;  ///< the client may send another request after this one
  std::vector<std::pair<std::string_view, std::string_view>> fields;  ///< trimmed, as they came

  bool has_body() const { return chunked || content_length > 0; }
};

/// One look at the bytes of a connection: at most one of the two is set, none while the head is not
/// whole.
struct HeadReading {
  std::optional<RequestHead> head;
  std::optional<Response> refusal;  ///< a problem document; the connection ends after it
};

/// Reads the head that begins at bytes[0], strictly (RFC 9112, sections 2 to 6), so that this
/// server and a proxy in front of it cannot take it for different requests: no folded fields, no
/// white space before a colon, no control characters, not even percent-encoded ones, one length, no
/// transfer coding but chunked, no form and no content coding that the API does not read, and a
/// Host. Looks at no more than `max_bytes`; linear in them.
HeadReading read_request_head(std::string_view bytes, const HeadLimits& limits);

}  // namespace cellmap::server
