#include "cellmap/store/page_cursor.hpp"

#include <bit>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <span>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kDigits = 16 + 16 + 8;  // query, distance, id in hexadecimal

std::string hex(std::uint64_t value, int digits) {
  char text[17];
  std::snprintf(text, sizeof(text), "%0*llx", digits, static_cast<unsigned long long>(value));
  return text;
}

std::uint64_t from_hex(std::string_view text) {
  std::uint64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, 16);
  if (error != std::errc() || end != text.data() + text.size()) {
    throw Error(ErrorCode::kInvalidArgument,
                "cursor: expected the next_cursor of the page before, unchanged");
  }
  return value;
}

std::string hex(const Eigen::Vector3d& v) {
  std::string text;
  for (const double value : v) text += hex(std::bit_cast<std::uint64_t>(value), 16);
  return text;
}

/// 64 bits that tell one query from another.
std::string fingerprint(const std::string& map, const CellQuery& query) {
  std::string text = map + '/' + std::to_string(query.since);
  if (query.near)
    text += "/near" + hex(*query.near) + hex(std::bit_cast<std::uint64_t>(query.radius_m), 16);
  if (query.box) text += "/box" + hex(query.box->min()) + hex(query.box->max());
  if (query.session) text += "/session" + *query.session;
  return to_hex(sha256(std::as_bytes(std::span(text)))).substr(0, 16);
}

}  // namespace

std::string to_text(const PageCursor& cursor, const std::string& map, const CellQuery& query) {
  return fingerprint(map, query) + hex(std::bit_cast<std::uint64_t>(cursor.squared_distance), 16) +
         hex(cursor.id.value, 8);
}

std::optional<PageCursor> page_cursor(const std::string& map, const CellQuery& query) {
  if (query.cursor.empty()) return std::nullopt;
  const std::string_view text = query.cursor;
  if (text.size() != kDigits || text.substr(0, 16) != fingerprint(map, query)) {
    throw Error(ErrorCode::kInvalidArgument,
                "cursor: expected the next_cursor of a page of this same query");
  }
  PageCursor cursor;
  cursor.squared_distance = std::bit_cast<double>(from_hex(text.substr(16, 16)));
  cursor.id.value = static_cast<std::uint32_t>(from_hex(text.substr(32, 8)));
  if (!std::isfinite(cursor.squared_distance)) {
    throw Error(ErrorCode::kInvalidArgument, "cursor: holds a distance that is not finite");
  }
  return cursor;
}

}  // namespace cellmap
