#include "server/api/conditions.hpp"

#include <algorithm>

#include "server/api/text.hpp"

namespace cellmap::server {
namespace {

/// An element of a list such as Accept: its name and its quality.
struct Weighted {
  std::string_view name;
  double quality = 1;
};

/// Calls `use` for each element.
template <typename Use>
void for_each_weighted(std::string_view header, const Use& use) {
  for_each_part(header, ',', [&](std::string_view element) {
    Weighted weighted;
    bool is_first = true;
    for_each_part(element, ';', [&](std::string_view part) {
      if (is_first) {
        weighted.name = part;
      } else if (part.starts_with("q=") || part.starts_with("Q=")) {
        weighted.quality = std::clamp(parse_number(part.substr(2)).value_or(0), 0.0, 1.0);
      }
      is_first = false;
    });
    if (!weighted.name.empty()) use(weighted);
  });
}

/// 3: the type itself, 2: its "type/*", 1: "*/*", 0: no match. More specific wins (RFC
/// 9110, 12.5.1).
int specificity(std::string_view pattern, std::string_view type) {
  if (equal_no_case(pattern, type)) return 3;
  if (pattern == "*/*") return 1;
  if (!pattern.ends_with("/*")) return 0;
  const auto prefix = pattern.substr(0, pattern.size() - 1);
  return equal_no_case(prefix, type.substr(0, prefix.size())) ? 2 : 0;
}

double quality_of(std::string_view type, std::string_view accept) {
  int best = 0;
  double quality = 0;
  for_each_weighted(accept, [&](const Weighted& element) {
    const int match = specificity(element.name, type);
    if (match <= best) return;
    best = match;
    quality = element.quality;
  });
  return quality;
}

/// Of the first that is named so.
std::optional<double> coding_quality(std::string_view name, std::string_view accept_encoding) {
  std::optional<double> quality;
  for_each_weighted(accept_encoding, [&](const Weighted& element) {
    if (!quality && equal_no_case(element.name, name)) quality = element.quality;
  });
  return quality;
}

}  // namespace

bool matches_etag(std::string_view if_none_match, std::span<const std::string> etags) {
  for (auto tag : split(if_none_match, ',')) {
    if (tag == "*") return true;
    if (tag.starts_with("W/")) tag.remove_prefix(2);
    if (std::ranges::find(etags, tag) != etags.end()) return true;
  }
  return false;
}

RangeRequest parse_range(std::string_view header, std::size_t size) {
  constexpr std::string_view kUnit = "bytes=";
  if (header.size() < kUnit.size() || !equal_no_case(header.substr(0, kUnit.size()), kUnit)) {
    return {};
  }
  const auto ranges = split(header.substr(kUnit.size()), ',');
  if (ranges.size() != 1) return {};
  const auto dash = ranges[0].find('-');
  if (dash == std::string_view::npos) return {};
  const auto first = parse_unsigned(ranges[0].substr(0, dash));
  const auto last = parse_unsigned(ranges[0].substr(dash + 1));
  const bool has_first = dash > 0, has_last = dash + 1 < ranges[0].size();
  if (has_first != first.has_value() || has_last != last.has_value()) return {};
  if (!first && !last) return {};
  if (!first) {  // the last N bytes
    const std::size_t length = std::min<std::size_t>(*last, size);
    if (length == 0) return {.satisfiable = false, .range = {}};
    return {.satisfiable = true, .range = ByteRange{size - length, length}};
  }
  if (last && *last < *first) return {};
  if (*first >= size) return {.satisfiable = false, .range = {}};
  const std::size_t end = last ? std::min<std::size_t>(*last, size - 1) : size - 1;
  return {.satisfiable = true, .range = ByteRange{*first, end - *first + 1}};
}

std::optional<std::string_view> negotiate(std::optional<std::string_view> accept,
                                          std::span<const std::string_view> available) {
  if (!accept || trimmed(*accept).empty()) return available.front();
  std::optional<std::string_view> best;
  double best_quality = 0;
  for (const auto type : available) {
    const double quality = quality_of(type, *accept);
    if (quality <= best_quality) continue;
    best = type;
    best_quality = quality;
  }
  return best;
}

bool accepts_coding(std::optional<std::string_view> accept_encoding, std::string_view coding) {
  if (!accept_encoding) return false;
  auto quality = coding_quality(coding, *accept_encoding);
  if (!quality) quality = coding_quality("*", *accept_encoding);
  return quality.value_or(0) > 0 &&
         *quality >= coding_quality("identity", *accept_encoding).value_or(0);
}

std::string media_type(std::string_view content_type) {
  std::string type(trimmed(content_type.substr(0, content_type.find(';'))));
  std::ranges::transform(type, type.begin(), [](unsigned char c) { return std::tolower(c); });
  return type;
}

std::optional<ByteRange> answer_range(std::optional<std::string_view> range, std::size_t size,
                                      Response& response) {
  const auto asked = range ? parse_range(*range, size) : RangeRequest{};
  if (!asked.satisfiable) return std::nullopt;
  if (!asked.range) return ByteRange{0, size};
  const auto [offset, length] = *asked.range;
  response.status = 206;
  response.headers.set("Content-Range", "bytes " + std::to_string(offset) + "-" +
                                            std::to_string(offset + length - 1) + "/" +
                                            std::to_string(size));
  return asked.range;
}

}  // namespace cellmap::server
