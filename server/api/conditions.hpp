#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "server/api/message.hpp"

namespace cellmap::server {

/// RFC 9110 as far as the API needs it: validators, ranges and negotiation. Pure functions of
/// header values; malformed values are ignored as the RFC asks.

/// True where an If-None-Match value names one of the entity tags (each with its quotes) or is `*`.
/// Weak comparison.
bool matches_etag(std::string_view if_none_match, std::span<const std::string> etags);

/// What a Range header asks of `size` bytes.
struct ByteRange {
  std::size_t offset = 0;
  std::size_t length = 0;
};
struct RangeRequest {
  bool satisfiable = true;
  /// Set for one range. Not set where the whole is to be sent: no or malformed range, or several.
  std::optional<ByteRange> range;
};
RangeRequest parse_range(std::string_view header, std::size_t size);

/// The part of `size` bytes that a Range header asks for, or all of them; says so in the response
/// (206, Content-Range). Nullopt: there is no such part (`range_not_satisfiable`).
std::optional<ByteRange> answer_range(std::optional<std::string_view> range, std::size_t size,
                                      Response& response);

/// The media type of `available` with the highest quality in an Accept value; the first of equals,
/// and the first of all where there is no Accept. Nullopt: none is acceptable.
std::optional<std::string_view> negotiate(std::optional<std::string_view> accept,
                                          std::span<const std::string_view> available);

/// True where an Accept-Encoding value allows the coding by name or by `*` with a quality above 0
/// that is not below that of identity where identity is named.
bool accepts_coding(std::optional<std::string_view> accept_encoding, std::string_view coding);

/// The media type of a Content-Type value, lower case, without parameters.
std::string media_type(std::string_view content_type);

}  // namespace cellmap::server
