#include "cellmap/codec/place_search_codec.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>

#include "place/random_places.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;
using test::RandomPlaces;
using test::some_views;

PlaceQuery some_query(const RandomPlaces& places, const SearchTerms& terms, bool ahead = false) {
  PlaceQuery query{some_views(1, ahead), terms, 77, {}};
  for (const auto& region : places.regions().all()) {
    query.regions.push_back({region.key, checksum_of_cells(region)});
  }
  return query;
}

/// Replaces a number where it lies first.
template <typename Number>
Bytes with_number(Bytes bytes, Number before, Number after) {
  for (std::size_t i = 0; i + sizeof(Number) <= bytes.size(); ++i) {
    if (std::memcmp(&bytes[i], &before, sizeof(Number)) != 0) continue;
    std::memcpy(&bytes[i], &after, sizeof(Number));
    return bytes;
  }
  ADD_FAILURE() << "it is not there";
  return bytes;
}

TEST(PlaceSearchCodec, AQueryArrivesBitForBit) {
  const RandomPlaces places(200);
  for (const bool ahead : {false, true}) {
    const PlaceQuery query = some_query(places, {30, true}, ahead);
    const PlaceQuery read = decode_place_query(encode_place_query(query));
    EXPECT_EQ(read.views.all().cosine, query.views.all().cosine);
    EXPECT_EQ(read.views.all().sine, query.views.all().sine);
    EXPECT_EQ(read.views.some().cosine, query.views.some().cosine);
    EXPECT_EQ(read.views.seen(), query.views.seen());
    EXPECT_EQ(read.views.sees_all(), !ahead);
    EXPECT_EQ(read.terms.count, 30u);
    EXPECT_TRUE(read.terms.first_look);
    EXPECT_EQ(read.revision, 77u);
    ASSERT_EQ(read.regions.size(), query.regions.size());
    for (std::size_t i = 0; i < read.regions.size(); ++i) {
      EXPECT_EQ(read.regions[i].key, query.regions[i].key);
      EXPECT_EQ(read.regions[i].cells, query.regions[i].cells);
    }
    for (const auto& [id, place] : places.places()) {
      ASSERT_EQ(likeness(read.views, place), likeness(query.views, place));
      ASSERT_EQ(first_likeness(read.views, place), first_likeness(query.views, place));
    }
  }
}

TEST(PlaceSearchCodec, AnAnswerArrivesBitForBit) {
  const RandomPlaces places(2'300);
  for (const SearchTerms terms : {SearchTerms{30, true}, SearchTerms{250, false}}) {
    PlaceAnswer answer;
    answer.unknown = {1, 5};
    answer.places = places.searcher().search(some_views(1), places.list(), terms, 1);
    const Bytes bytes = encode_place_answer(answer, terms);
    const PlaceAnswer read = decode_place_answer(bytes, terms, 6);
    EXPECT_EQ(read.unknown, answer.unknown);
    ASSERT_EQ(read.places.size(), terms.kept());
    const auto may = may_be_best(answer.places, terms.count);
    for (std::size_t i = 0; i < read.places.size(); ++i) {
      EXPECT_EQ(read.places[i].id, answer.places[i].id);
      EXPECT_EQ(read.places[i].first, answer.places[i].first);
      EXPECT_EQ(read.places[i].likeness, answer.places[i].likeness);
      ASSERT_EQ(read.places[i].place != nullptr, may[i]);
      if (!may[i]) continue;
      EXPECT_EQ(to_bytes(*read.places[i].place), to_bytes(*answer.places[i].place));
    }
    // Other terms than it was made for.
    expect_error(ErrorCode::kCorruptData, [&] {
      decode_place_answer(bytes, {terms.count - 1, false}, 6);
    });
    expect_error(ErrorCode::kCorruptData, [&] { decode_place_answer(bytes, terms, 5); });
  }
}

TEST(PlaceSearchCodec, WhatIsCutOffIsRefused) {
  const RandomPlaces places(100);
  const SearchTerms terms{10, false};
  const Bytes query = encode_place_query(some_query(places, terms));
  PlaceAnswer answer;
  answer.places = places.searcher().search(some_views(1), places.list(), terms, 1);
  const Bytes bytes = encode_place_answer(answer, terms);
  const std::span<const std::byte> all_of_it(query), all(bytes);
  for (std::size_t size = 0; size < query.size(); size += 1 + size / 50) {
    EXPECT_THROW(decode_place_query(all_of_it.first(size)), Error) << size;
  }
  for (std::size_t size = 0; size < bytes.size(); size += 1 + size / 50) {
    EXPECT_THROW(decode_place_answer(all.first(size), terms, 5), Error) << size;
  }
  expect_error(ErrorCode::kCorruptData, [&] { decode_place_query(bytes); });
  expect_error(ErrorCode::kCorruptData, [&] { decode_place_answer(query, terms, 5); });
}

TEST(PlaceSearchCodec, NumbersThatAreNoneAreRefused) {
  const RandomPlaces places(100);
  const SearchTerms terms{10, false};
  const PlaceQuery query = some_query(places, terms);
  const float coefficient = query.views.signatures()[3].sine()(2, 4);
  ASSERT_NE(coefficient, 0.0f);
  PlaceAnswer answer;
  answer.places = places.searcher().search(some_views(1), places.list(), terms, 1);
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity(), -3e38f}) {
    expect_error(ErrorCode::kCorruptData, [&] {
      decode_place_query(with_number(encode_place_query(query), coefficient, bad));
    });
    expect_error(ErrorCode::kCorruptData, [&] {
      decode_place_answer(
          with_number(encode_place_answer(answer, terms), answer.places[4].likeness, bad), terms,
          5);
    });
  }
}

TEST(PlaceSearchCodec, WhatContradictsItselfIsRefused) {
  const RandomPlaces places(100);
  const SearchTerms terms{10, false};
  const auto answer_with = [&](const std::function<void(PlaceAnswer&)>& change) {
    PlaceAnswer answer;
    answer.places = places.searcher().search(some_views(1), places.list(), terms, 1);
    change(answer);
    return encode_place_answer(answer, terms);
  };
  const auto refused = [&](const std::function<void(PlaceAnswer&)>& change) {
    expect_error(ErrorCode::kCorruptData,
                 [&] { decode_place_answer(answer_with(change), terms, 5); });
  };
  EXPECT_NO_THROW(decode_place_answer(answer_with([](PlaceAnswer&) {}), terms, 5));
  refused([](PlaceAnswer& a) { std::swap(a.places[2], a.places[3]); });
  refused([](PlaceAnswer& a) { a.places[3].id = a.places[2].id; });
  refused([](PlaceAnswer& a) { a.places[9].likeness -= 0.1f; });
  refused([](PlaceAnswer& a) { a.unknown = {3, 2}; });
  refused([](PlaceAnswer& a) { a.unknown = {5}; });
  PlaceQuery query = some_query(places, terms);
  std::swap(query.regions[0], query.regions[1]);
  expect_error(ErrorCode::kCorruptData, [&] { decode_place_query(encode_place_query(query)); });
  query = some_query(places, {kMaxAskedPlaces + 1, false});
  expect_error(ErrorCode::kTooLarge, [&] { encode_place_query(query); });
}

/// A server of another form is told so, and does not get an answer that means something else.
TEST(PlaceSearchCodec, AnotherFormOrVersionIsUnsupported) {
  const RandomPlaces places(20);
  const Bytes good = encode_place_query(some_query(places, {10, false}));
  int unsupported = 0;
  // The version and the form are the only two numbers of one as 16 bits in the table's fields.
  for (std::size_t i = 0; i + 2 <= 64; i += 2) {
    Bytes bytes = good;
    std::uint16_t number = 0;
    std::memcpy(&number, &bytes[i], 2);
    if (number != 1) continue;
    number = 2;
    std::memcpy(&bytes[i], &number, 2);
    try {
      decode_place_query(bytes);
    } catch (const Error& error) {
      unsupported += error.code() == ErrorCode::kUnsupported;
    }
  }
  EXPECT_EQ(unsupported, 2);
}

}  // namespace
}  // namespace cellmap
