// A request target and values of header fields; the first byte says which.
#include "fuzz/fuzz.hpp"
#include "server/api/conditions.hpp"
#include "server/api/router.hpp"
#include "server/api/text.hpp"

namespace {

using namespace cellmap::server;

/// A range that is satisfiable lies within what there is.
void check_range(std::string_view header, std::size_t size) {
  const auto asked = parse_range(header, size);
  if (!asked.range) return;
  const auto [offset, length] = *asked.range;
  if (length == 0 || offset >= size || length > size - offset) {
    throw std::logic_error("a range outside of the bytes");
  }
}

}  // namespace

FUZZ_TARGET(bytes) {
  const int kind = cellmap::fuzz::take_kind(bytes, 4);
  const std::string text(cellmap::fuzz::text_of(bytes));
  constexpr std::array<std::string_view, 2> available{"application/vnd.cellmap.cell",
                                                      "application/json"};
  const std::vector<std::string> etags{"\"a\"", "\"b-zstd\""};
  switch (kind) {
    case 0:
      parse_target(text);
      return;
    case 1:
      for (const std::size_t size : {std::size_t{0}, std::size_t{1}, std::size_t{1000}, SIZE_MAX}) {
        check_range(text, size);
      }
      return;
    case 2:
      negotiate(text, available);
      accepts_coding(text, "zstd");
      matches_etag(text, etags);
      media_type(text);
      return;
    default:
      parse_numbers(text, ',', 7, "'pose'");
  }
}
