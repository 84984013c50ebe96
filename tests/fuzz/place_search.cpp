// What servers tell each other while they relocalise: a query, or the answer to one.
#include "cellmap/codec/place_search_codec.hpp"
#include "fuzz/fuzz.hpp"

FUZZ_TARGET(bytes) {
  using namespace cellmap;
  const int kind = fuzz::take_kind(bytes, 3);
  if (kind == 0) {
    const PlaceQuery query = decode_place_query(bytes);
    fuzz::must_work([&] { decode_place_query(encode_place_query(query)); });
  } else {
    const SearchTerms terms{3, kind == 2};
    const PlaceAnswer answer = decode_place_answer(bytes, terms, 10);
    fuzz::must_work([&] { decode_place_answer(encode_place_answer(answer, terms), terms, 10); });
  }
}
