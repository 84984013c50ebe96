// The file of tokens.
#include "server/auth/token_file.hpp"

#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  const auto tokens = auth::parse_tokens(fuzz::text_of(bytes), "tokens");
  fuzz::must_work([&] {
    for (const auto& token : tokens) auth::parse_tokens(auth::to_line(token), "again");
  });
}
