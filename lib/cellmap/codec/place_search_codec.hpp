#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/id.hpp"
#include "cellmap/place/place_search.hpp"

// What one server asks another while it relocalises, and what it is told: FlatBuffers buffers
// (schema/place_search.fbs), without loss, between servers of one database.

namespace cellmap {

/// A region and which CELLs the one who asks knows there (`checksum_of_cells`). Who answers counts
/// on no revision: it searches the regions that it knows in the same way.
struct AskedRegion {
  RegionKey key;
  std::uint64_t cells = 0;
};

struct PlaceQuery {
  QueryViews views;
  SearchTerms terms;
  Revision revision = 0;  ///< that the regions were made of
  std::vector<AskedRegion> regions;
};

struct PlaceAnswer {
  std::vector<std::uint32_t> unknown;  ///< regions, by their place in the query; ascending
  ComparedPlaces places;               ///< of all others
};

constexpr std::size_t kMaxAskedPlaces = 1'000;
constexpr std::size_t kMaxAskedRegions = 200'000;
constexpr std::size_t kMaxPlaceQueryBytes = 4u << 20;
constexpr std::size_t kMaxPlaceAnswerBytes = 4u << 20;

/// About 104 kB and 16 B a region. Throws Error{kTooLarge} over a limit.
Bytes encode_place_query(const PlaceQuery& query);
/// Trusts no byte: throws Error{kCorruptData}, {kTooLarge} over a limit, {kUnsupported} where the
/// other describes or compares places in another way.
PlaceQuery decode_place_query(std::span<const std::byte> bytes);

/// 12 B a place and 1.2 kB for each of those that may be among the best (`may_be_best`).
Bytes encode_place_answer(const PlaceAnswer& answer, const SearchTerms& terms);
/// As `decode_place_query`. Whether the CELLs lie in the regions that were asked for is the
/// caller's to see; no two are the same.
PlaceAnswer decode_place_answer(std::span<const std::byte> bytes, const SearchTerms& terms,
                                std::size_t asked_regions);

}  // namespace cellmap
