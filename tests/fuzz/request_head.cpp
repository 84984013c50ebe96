// The head of a request. What is accepted is accepted again when it came in two pieces, and refused
// the same.
#include "server/http/request_head.hpp"

#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap::server;
  const std::string_view text = cellmap::fuzz::text_of(bytes);
  const HeadReading whole = read_request_head(text, {});
  if (!whole.head) return;
  if (whole.head->size > text.size()) throw std::logic_error("a head longer than its bytes");
  const HeadReading part = read_request_head(text.substr(0, whole.head->size - 1), {});
  if (part.head || part.refusal) throw std::logic_error("the beginning of a head is judged apart");
}
