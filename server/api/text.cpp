#include "server/api/text.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "cellmap/core/error.hpp"

namespace cellmap::server {
namespace {

template <typename Number>
std::optional<Number> parse_whole(std::string_view text) {
  Number value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
  return value;
}

}  // namespace

std::string_view trimmed(std::string_view text) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t'; };
  while (!text.empty() && is_blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && is_blank(text.back())) text.remove_suffix(1);
  return text;
}

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for_each_part(text, separator, [&](std::string_view part) { parts.push_back(part); });
  return parts;
}

std::optional<std::uint64_t> parse_unsigned(std::string_view text) {
  return parse_whole<std::uint64_t>(text);
}

std::optional<double> parse_number(std::string_view text) {
  const auto value = parse_whole<double>(text);
  return value && std::isfinite(*value) ? value : std::nullopt;
}

std::vector<double> parse_numbers(std::string_view text, char separator, std::size_t count,
                                  std::string_view what) {
  std::vector<double> numbers;
  for (const auto part : split(text, separator)) {
    if (separator == ' ' && part.empty()) continue;
    const auto number = parse_number(part);
    if (!number || numbers.size() == count) {
      numbers.clear();
      break;
    }
    numbers.push_back(*number);
  }
  if (numbers.size() != count) {
    throw Error(ErrorCode::kInvalidArgument, std::string(what) + " must be " +
                                                 std::to_string(count) + " finite numbers, found " +
                                                 in_quotes(text) + ".");
  }
  return numbers;
}

std::optional<std::string> percent_decoded(std::string_view text) {
  std::string decoded;
  decoded.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    char c = text[i];
    if (c == '%') {
      unsigned value = 0;
      if (i + 2 >= text.size()) return std::nullopt;
      const char* digits = text.data() + i + 1;
      const auto [end, error] = std::from_chars(digits, digits + 2, value, 16);
      if (error != std::errc() || end != digits + 2) return std::nullopt;
      c = static_cast<char>(value);
      i += 2;
    }
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) return std::nullopt;
    decoded.push_back(c);
  }
  return decoded;
}

std::string in_quotes(std::string_view text) {
  constexpr std::size_t kMaxLength = 100;
  std::string result = "'";
  for (const char c : text.substr(0, kMaxLength)) {
    result += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? '?' : c;
  }
  return result + (text.size() > kMaxLength ? "...'" : "'");
}

}  // namespace cellmap::server
