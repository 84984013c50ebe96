#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cellmap::server {

/// ASCII, as of header names and media types.
constexpr char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

/// Without regard to case.
inline bool equal_no_case(std::string_view a, std::string_view b) {
  return std::ranges::equal(a, b, [](char x, char y) { return lower(x) == lower(y); });
}

std::string_view trimmed(std::string_view text);

/// Calls `use` for each part between separators, trimmed; an empty text has none.
template <typename Use>
void for_each_part(std::string_view text, char separator, const Use& use) {
  for (bool more = !text.empty(); more;) {
    const auto end = text.find(separator);
    use(trimmed(text.substr(0, end)));
    more = end != std::string_view::npos;
    if (more) text.remove_prefix(end + 1);
  }
}

/// All of them.
std::vector<std::string_view> split(std::string_view text, char separator);

/// The whole text as an unsigned decimal number without sign or space; nullopt for anything else.
std::optional<std::uint64_t> parse_unsigned(std::string_view text);

/// The whole text as a finite number; nullopt for anything else.
std::optional<double> parse_number(std::string_view text);

/// Exactly `count` finite numbers. Throws Error{kInvalidArgument} that begins with `what`.
std::vector<double> parse_numbers(std::string_view text, char separator, std::size_t count,
                                  std::string_view what);

/// Percent-decoding; nullopt for a broken escape or an encoded control character.
std::optional<std::string> percent_decoded(std::string_view text);

/// For messages: printable and at most 100 bytes long.
std::string in_quotes(std::string_view text);

}  // namespace cellmap::server
