#include "server/auth/token.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <span>

#include "cellmap/core/secret.hpp"

namespace cellmap::auth {
namespace {

constexpr std::array<std::pair<Scope, std::string_view>, 4> kScopes{{
    {Scope::kMapRead, "map:read"},
    {Scope::kMapWrite, "map:write"},
    {Scope::kRelocalise, "relocalise"},
    {Scope::kAdmin, "admin"},
}};

bool is_alphanumeric(char c) {
  return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

bool consists_of(std::string_view text, std::string_view others) {
  return std::ranges::all_of(
      text, [&](char c) { return is_alphanumeric(c) || others.find(c) != others.npos; });
}

/// The two or four digits at `at`, -1 where there are others.
int digits(std::string_view text, std::size_t at, std::size_t count) {
  const auto part = text.substr(at, count);
  int value = 0;
  const auto all_digits = [](char c) { return c >= '0' && c <= '9'; };
  if (part.size() != count || !std::ranges::all_of(part, all_digits)) return -1;
  std::from_chars(part.data(), part.data() + part.size(), value);
  return value;
}

}  // namespace

std::string_view to_string(Scope scope) {
  return std::ranges::find(kScopes, scope, &decltype(kScopes)::value_type::first)->second;
}

std::optional<Scope> scope_from_string(std::string_view text) {
  const auto* found = std::ranges::find(kScopes, text, &decltype(kScopes)::value_type::second);
  return found == kScopes.end() ? std::nullopt : std::optional(found->first);
}

std::string make_secret() { return "cellmap_" + random_text(32); }

ContentHash hash_of_secret(std::string_view secret) {
  return sha256(std::as_bytes(std::span(secret.data(), secret.size())));
}

bool is_secret(std::string_view text) {
  return !text.empty() && text.size() <= 128 && consists_of(text, "-._~+/=");
}

bool is_token_name(std::string_view text) {
  return !text.empty() && text.size() <= 64 && consists_of(text, "._-");
}

std::string to_text(Time time) {
  const auto day = std::chrono::floor<std::chrono::days>(time);
  const std::chrono::year_month_day date(day);
  const std::chrono::hh_mm_ss clock(time - day);
  char text[32];
  std::snprintf(text, sizeof(text), "%04d-%02u-%02uT%02d:%02d:%02dZ", static_cast<int>(date.year()),
                static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()),
                static_cast<int>(clock.hours().count()), static_cast<int>(clock.minutes().count()),
                static_cast<int>(clock.seconds().count()));
  return text;
}

std::optional<Time> time_from_text(std::string_view text) {
  std::string whole(text);
  if (whole.size() == 10) whole += "T00:00:00Z";
  constexpr std::string_view kShape = "....-..-..T..:..:..Z";
  if (whole.size() != kShape.size()) return std::nullopt;
  for (std::size_t i = 0; i < kShape.size(); ++i) {
    if (kShape[i] != '.' && whole[i] != kShape[i]) return std::nullopt;
  }
  const int year = digits(whole, 0, 4), month = digits(whole, 5, 2), day = digits(whole, 8, 2);
  const int hour = digits(whole, 11, 2), minute = digits(whole, 14, 2),
            second = digits(whole, 17, 2);
  if (std::min({year, month, day, hour, minute, second}) < 0) return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year(year),
                                         std::chrono::month(static_cast<unsigned>(month)),
                                         std::chrono::day(static_cast<unsigned>(day))};
  if (!date.ok() || hour > 23 || minute > 59 || second > 59) return std::nullopt;
  return std::chrono::sys_days(date) + std::chrono::hours(hour) + std::chrono::minutes(minute) +
         std::chrono::seconds(second);
}

}  // namespace cellmap::auth
