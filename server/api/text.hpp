#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace cellmap::server {

/// ASCII without regard to case, as header names and media types compare.
bool equal_no_case(std::string_view a, std::string_view b);

std::string_view trimmed(std::string_view text);

/// Parts between separators, trimmed; an empty text has none.
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
