#include "server/http/request_head.hpp"

#include <algorithm>
#include <array>
#include <string>

#include "cellmap/core/error.hpp"
#include "server/api/problem.hpp"
#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

/// Thrown inside this file only.
struct Refused {
  Response response;
};

[[noreturn]] void refuse(const std::string& detail) {
  throw Refused{problem(ErrorCode::kInvalidArgument, detail)};
}
[[noreturn]] void refuse(int status, ErrorCode code, const std::string& detail) {
  throw Refused{problem_with_status(status, code, detail)};
}

/// What may be in a token (RFC 9110, section 5.6.2), by character.
constexpr std::array<bool, 256> kInToken = [] {
  std::array<bool, 256> in_token{};
  for (const char c : std::string_view("!#$%&'*+-.^_`|~0123456789"
                                       "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz")) {
    in_token[static_cast<unsigned char>(c)] = true;
  }
  return in_token;
}();

bool is_token(std::string_view text) {
  return !text.empty() && std::ranges::all_of(text, [](unsigned char c) { return kInToken[c]; });
}

bool is_control(unsigned char c) { return (c < 0x20 && c != '\t') || c == 0x7f; }

/// httplib decodes percent-escapes in field values, so that a line feed can hide in one.
bool hides_control(std::string_view value) {
  const auto digit = [](char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
  };
  for (auto i = value.find('%'); i != value.npos && i + 2 < value.size();
       i = value.find('%', i + 1)) {
    const int high = digit(value[i + 1]), low = digit(value[i + 2]);
    if (high >= 0 && low >= 0 && is_control(static_cast<unsigned char>(16 * high + low))) {
      return true;
    }
  }
  return false;
}

/// True for HTTP/1.1, false for 1.0.
bool read_request_line(std::string_view line, const HeadLimits& limits, RequestHead& head) {
  const auto first = line.find(' '), last = line.rfind(' ');
  if (first == line.npos || first == last) {
    refuse("Expected a request line 'METHOD TARGET HTTP/1.1'.");
  }
  head.method = line.substr(0, first);
  head.target = line.substr(first + 1, last - first - 1);
  const auto version = line.substr(last + 1);
  if (!is_token(head.method)) refuse("The request method is no token.");
  if (version != "HTTP/1.1" && version != "HTTP/1.0") {
    if (version.starts_with("HTTP/")) {
      refuse(505, ErrorCode::kUnsupported, "This server speaks HTTP/1.1.");
    }
    refuse("Expected a request line 'METHOD TARGET HTTP/1.1'.");
  }
  if (head.target.size() > limits.max_target_bytes) {
    refuse(414, ErrorCode::kTooLarge,
           "The request target may have " + std::to_string(limits.max_target_bytes) + " bytes.");
  }
  const bool printable =
      std::ranges::all_of(head.target, [](unsigned char c) { return c > 0x20 && c < 0x7f; });
  if (!printable || (!head.target.starts_with('/') && head.target != "*")) {
    refuse("Expected a request target that begins with '/'.");
  }
  return version == "HTTP/1.1";
}

/// What the fields say, gathered one by one.
struct Fields {
  std::size_t lengths = 0, transfer_codings = 0, hosts = 0;
  bool says_close = false, says_keep = false;
};

void read_field(std::string_view line, RequestHead& head, Fields& fields) {
  if (line.starts_with(' ') || line.starts_with('\t')) refuse("A header field is folded.");
  const auto colon = line.find(':');
  if (colon == line.npos || !is_token(line.substr(0, colon))) {
    refuse("A header field is not 'Name: value'.");
  }
  const auto name = line.substr(0, colon), value = trimmed(line.substr(colon + 1));
  if (std::ranges::any_of(value, is_control) || hides_control(value)) {
    refuse("A header field holds a control character.");
  }
  head.fields.emplace_back(name, value);
  if (equal_no_case(name, "Content-Length")) {
    const auto length = parse_unsigned(value);
    if (!length) refuse("Content-Length is not a number.");
    head.content_length = *length;
    ++fields.lengths;
  } else if (equal_no_case(name, "Transfer-Encoding")) {
    if (!equal_no_case(value, "chunked")) {
      refuse(501, ErrorCode::kUnsupported, "Only the transfer coding 'chunked' is read.");
    }
    head.chunked = true;
    ++fields.transfer_codings;
  } else if (equal_no_case(name, "Host")) {
    ++fields.hosts;
  } else if (equal_no_case(name, "Connection")) {
    for (const auto option : split(value, ',')) {
      if (equal_no_case(option, "close")) fields.says_close = true;
      if (equal_no_case(option, "keep-alive")) fields.says_keep = true;
    }
  } else if (equal_no_case(name, "Content-Encoding")) {
    if (!value.empty() && !equal_no_case(value, "identity") && !equal_no_case(value, "zstd")) {
      refuse(415, ErrorCode::kUnsupported,
             "Bodies are read with Content-Encoding zstd or none, not " + in_quotes(value) + ".");
    }
  } else if (equal_no_case(name, "Content-Type")) {
    if (value.size() >= 10 && equal_no_case(value.substr(0, 10), "multipart/")) {
      refuse(415, ErrorCode::kUnsupported, "Forms are not read.");
    }
  }
}

/// The next line without its end, which is taken from `text` too. There is one.
std::string_view take_line(std::string_view& text) {
  const auto end = text.find('\n');
  const auto line = text.substr(0, end);
  text.remove_prefix(end + 1);
  if (line.empty() || line.find('\r') != line.size() - 1) refuse("A line does not end with CR LF.");
  return line.substr(0, line.size() - 1);
}

RequestHead read_whole(std::string_view bytes, const HeadLimits& limits) {
  RequestHead head;
  head.fields.reserve(16);  // more than nearly all have
  head.size = bytes.size();
  head.is_http_1_0 = !read_request_line(take_line(bytes), limits, head);
  Fields fields;
  for (auto line = take_line(bytes); !line.empty(); line = take_line(bytes)) {
    if (head.fields.size() == limits.max_fields) {
      refuse(431, ErrorCode::kTooLarge,
             "A request may have " + std::to_string(limits.max_fields) + " header fields.");
    }
    read_field(line, head, fields);
  }
  if (fields.lengths + fields.transfer_codings > 1) {
    refuse("The length of the body is given twice.");
  }
  if (fields.hosts > 1 || (!head.is_http_1_0 && fields.hosts == 0)) {
    refuse("Expected one Host field.");
  }
  head.keep = !fields.says_close && (!head.is_http_1_0 || fields.says_keep);
  return head;
}

}  // namespace

HeadReading read_request_head(std::string_view bytes, const HeadLimits& limits) {
  const auto end = bytes.substr(0, limits.max_bytes).find("\r\n\r\n");
  try {
    if (end == bytes.npos) {
      // A bare LF would never find its end; told at once rather than when time is up.
      if (const auto lf = bytes.find('\n');
          lf != bytes.npos && (lf == 0 || bytes[lf - 1] != '\r')) {
        refuse("A line does not end with CR LF.");
      }
      if (bytes.size() < limits.max_bytes) return {};
      const bool in_line = bytes.substr(0, limits.max_bytes).find("\r\n") == bytes.npos;
      refuse(in_line ? 414 : 431, ErrorCode::kTooLarge,
             "The head of a request may have " + std::to_string(limits.max_bytes) + " bytes.");
    }
    return {read_whole(bytes.substr(0, end + 4), limits), std::nullopt};
  } catch (Refused& refused) {
    return {std::nullopt, std::move(refused.response)};
  }
}

}  // namespace cellmap::server
