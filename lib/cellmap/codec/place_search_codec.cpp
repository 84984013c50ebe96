#include "cellmap/codec/place_search_codec.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>

#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/place_search_generated.h"

namespace cellmap {
namespace {

/// To be raised with every change of how places are described or compared: servers of different
/// forms do not search for each other.
constexpr std::uint16_t kForm = 1;
constexpr char kAnswerIdentifier[] = "CPLR";

constexpr BufferKind kQueryKind = {
    "search for places", "CPLQ", kMaxPlaceQueryBytes,
    [](flatbuffers::Verifier& v) { return schema::VerifyPlaceQueryBuffer(v); }};
constexpr BufferKind kAnswerKind = {"answer to a search for places", kAnswerIdentifier,
                                    kMaxPlaceAnswerBytes, [](flatbuffers::Verifier& v) {
                                      return v.VerifyBuffer<schema::PlaceAnswer>(kAnswerIdentifier);
                                    }};

constexpr std::size_t kCoefficients = CompactSignature::kCoefficients;
constexpr std::size_t kViewFloats = 2 * kCoefficients;
constexpr std::size_t kSectors = PlaceSignature::kSectors;
static_assert(sizeof(schema::AskedRegion) == 16);

[[noreturn]] void refuse_search(const std::string& what) {
  throw Error(ErrorCode::kCorruptData, "the bytes are no search for places: " + what);
}

void check_counts(const SearchTerms& terms, std::size_t regions) {
  if (terms.count <= kMaxAskedPlaces && regions <= kMaxAskedRegions) return;
  throw Error(ErrorCode::kTooLarge, "a search is for at most " + std::to_string(kMaxAskedPlaces) +
                                        " places in " + std::to_string(kMaxAskedRegions) +
                                        " regions, but " + std::to_string(terms.count) + " in " +
                                        std::to_string(regions) + " were asked for");
}

/// The verifier does not check the alignment of what lies in vectors.
template <typename Element>
std::vector<Element> copied_column(const flatbuffers::Vector<Element>& wire) {
  std::vector<Element> column(wire.size());
  if (!column.empty()) std::memcpy(column.data(), wire.Data(), column.size() * sizeof(Element));
  return column;
}

void require_finite(std::span<const float> numbers, float most) {
  for (const float number : numbers) {
    if (!(std::abs(number) <= most)) refuse_search("a number is out of range");
  }
}

std::vector<float> coefficients_of(const QueryViews& views) {
  std::vector<float> all;
  all.reserve(QueryViews::kViews * kViewFloats);
  for (const PlaceSignature& view : views.signatures()) {
    all.insert(all.end(), view.cosine().data(), view.cosine().data() + kCoefficients);
    all.insert(all.end(), view.sine().data(), view.sine().data() + kCoefficients);
  }
  return all;
}

std::uint64_t bits_of(const QueryViews::Seen& seen) {
  std::uint64_t bits = 0;
  for (std::size_t s = 0; s < kSectors; ++s) bits |= std::uint64_t{seen[s]} << s;
  return bits;
}

QueryViews views_from_wire(const schema::PlaceQuery& wire) {
  constexpr float kMost = 1.001f;  // of what has unit norm
  const std::vector<float> all = copied_column(*wire.coefficients());
  if (all.size() != QueryViews::kViews * kViewFloats) refuse_search("it lacks coefficients");
  require_finite(all, kMost);
  std::vector<PlaceSignature> signatures;
  signatures.reserve(QueryViews::kViews);
  for (std::size_t view = 0; view < QueryViews::kViews; ++view) {
    PlaceSignature::Spectrum<float> cosine, sine;
    std::memcpy(cosine.data(), &all[view * kViewFloats], kCoefficients * sizeof(float));
    std::memcpy(sine.data(), &all[view * kViewFloats + kCoefficients],
                kCoefficients * sizeof(float));
    signatures.emplace_back(cosine, sine, std::array<float, kSectors>{});
  }
  if (wire.seen() >> kSectors != 0) refuse_search("it sees more sectors than there are");
  QueryViews::Seen seen;
  for (std::size_t s = 0; s < kSectors; ++s) seen[s] = (wire.seen() >> s & 1) != 0;
  return {std::move(signatures), seen};
}

std::vector<AskedRegion> regions_from_wire(const schema::PlaceQuery& wire) {
  std::vector<AskedRegion> regions(wire.regions()->size());
  const std::uint8_t* at = wire.regions()->Data();
  for (AskedRegion& region : regions) {
    std::memcpy(&region.key.x, at, 4);
    std::memcpy(&region.key.y, at + 4, 4);
    std::memcpy(&region.cells, at + 8, 8);
    at += sizeof(schema::AskedRegion);
  }
  const auto not_ascending = [](const AskedRegion& a, const AskedRegion& b) {
    return !(a.key < b.key);
  };
  if (std::ranges::adjacent_find(regions, not_ascending) != regions.end()) {
    refuse_search("its regions are not in order");
  }
  return regions;
}

/// Puts the descriptions to the places that have one.
void describe_from_wire(const schema::PlaceAnswer& wire, const SearchTerms& terms,
                        ComparedPlaces& places) {
  const std::vector<bool> described = may_be_best(places, terms.count);
  const auto count = static_cast<std::size_t>(std::ranges::count(described, true));
  const std::span bytes(reinterpret_cast<const std::byte*>(wire.descriptions()->data()),
                        wire.descriptions()->size());
  if (bytes.size() != count * kDescribedPlaceBytes) refuse_search("it lacks descriptions");
  std::size_t at = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (!described[i]) continue;
    const auto place = described_place_from_bytes(bytes.subspan(at, kDescribedPlaceBytes));
    if (!place) refuse_search("a description is damaged or of another form");
    places[i].place = std::make_unique<const DescribedPlace>(*place);
    at += kDescribedPlaceBytes;
  }
}

ComparedPlaces places_from_wire(const schema::PlaceAnswer& wire, const SearchTerms& terms) {
  constexpr float kMost = 10.0f;  // an agreement is at most 1, divided by a share of 0.6 or more
  const auto cells = copied_column(*wire.cells());
  const auto first = copied_column(*wire.first());
  const auto likeness = copied_column(*wire.likeness());
  if (cells.size() > terms.kept() || first.size() != cells.size() ||
      likeness.size() != cells.size()) {
    refuse_search("its columns differ in length, or it has more places than were wanted");
  }
  require_finite(first, kMost);
  require_finite(likeness, kMost);
  auto ids = cells;
  std::ranges::sort(ids);
  if (std::ranges::adjacent_find(ids) != ids.end()) refuse_search("a CELL is there twice");
  ComparedPlaces places;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    if (i > 0 && std::pair(-first[i], cells[i]) < std::pair(-first[i - 1], cells[i - 1])) {
      refuse_search("its places are not in order");
    }
    if (!terms.first_look && first[i] != likeness[i]) refuse_search("it took a first look");
    places.push_back({CellId{cells[i]}, first[i], likeness[i], nullptr});
  }
  describe_from_wire(wire, terms, places);
  return places;
}

Bytes finished(const flatbuffers::FlatBufferBuilder& builder, const BufferKind& kind) {
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  check_size({begin, builder.GetSize()}, kind);
  return Bytes(begin, begin + builder.GetSize());
}

}  // namespace

Bytes encode_place_query(const PlaceQuery& query) {
  check_counts(query.terms, query.regions.size());
  flatbuffers::FlatBufferBuilder builder(1u << 18);
  std::vector<schema::AskedRegion> regions;
  regions.reserve(query.regions.size());
  for (const AskedRegion& one : query.regions)
    regions.emplace_back(one.key.x, one.key.y, one.cells);
  const auto wire_coefficients = builder.CreateVector(coefficients_of(query.views));
  const auto wire_regions = builder.CreateVectorOfStructs(regions);
  schema::FinishPlaceQueryBuffer(
      builder, schema::CreatePlaceQuery(builder, kFormatVersion, kForm, query.revision,
                                        static_cast<std::uint16_t>(query.terms.count),
                                        query.terms.first_look, bits_of(query.views.seen()),
                                        wire_coefficients, wire_regions));
  return finished(builder, kQueryKind);
}

PlaceQuery decode_place_query(std::span<const std::byte> bytes) {
  const Bytes copy = verified_copy(bytes, kQueryKind, 1);
  const auto& wire = *schema::GetPlaceQuery(copy.data());
  if (wire.form() != kForm) {
    throw Error(ErrorCode::kUnsupported, "this search for places is of form " +
                                             std::to_string(wire.form()) +
                                             ", but this server's is of form " +
                                             std::to_string(kForm) + "; update the older one");
  }
  const SearchTerms terms{wire.count(), wire.first_look()};
  check_counts(terms, wire.regions()->size());
  return {views_from_wire(wire), terms, wire.revision(), regions_from_wire(wire)};
}

Bytes encode_place_answer(const PlaceAnswer& answer, const SearchTerms& terms) {
  check_counts(terms, answer.unknown.size());
  std::vector<std::uint32_t> cells;
  std::vector<float> first, likeness;
  std::vector<std::uint8_t> descriptions;
  const std::vector<bool> described = may_be_best(answer.places, terms.count);
  for (std::size_t i = 0; i < answer.places.size(); ++i) {
    const ComparedPlace& place = answer.places[i];
    cells.push_back(place.id.value);
    first.push_back(place.first);
    likeness.push_back(place.likeness);
    if (!described[i]) continue;
    for (const std::byte b : to_bytes(*place.place)) {
      descriptions.push_back(std::to_integer<std::uint8_t>(b));
    }
  }
  flatbuffers::FlatBufferBuilder builder(1u << 18);
  const auto wire_unknown = builder.CreateVector(answer.unknown);
  const auto wire_cells = builder.CreateVector(cells);
  const auto wire_first = builder.CreateVector(first);
  const auto wire_likeness = builder.CreateVector(likeness);
  const auto wire_descriptions = builder.CreateVector(descriptions);
  builder.Finish(schema::CreatePlaceAnswer(builder, kFormatVersion, wire_unknown, wire_cells,
                                           wire_first, wire_likeness, wire_descriptions),
                 kAnswerIdentifier);
  return finished(builder, kAnswerKind);
}

PlaceAnswer decode_place_answer(std::span<const std::byte> bytes, const SearchTerms& terms,
                                std::size_t asked_regions) {
  const Bytes copy = verified_copy(bytes, kAnswerKind, 1);
  const auto& wire = *flatbuffers::GetRoot<schema::PlaceAnswer>(copy.data());
  PlaceAnswer answer;
  answer.unknown = copied_column(*wire.unknown());
  for (std::size_t i = 0; i < answer.unknown.size(); ++i) {
    const bool ascends = i == 0 || answer.unknown[i] > answer.unknown[i - 1];
    if (!ascends || answer.unknown[i] >= asked_regions) refuse_search("it names other regions");
  }
  answer.places = places_from_wire(wire, terms);
  return answer;
}

}  // namespace cellmap
