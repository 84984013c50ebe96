#pragma once

#include <cstddef>
#include <vector>

#include "cellmap/place/described_query.hpp"
#include "cellmap/place/place_part.hpp"

namespace cellmap {

/// A CELL that a search found, with a copy of its description: the part that it lay in may be gone.
struct AlikePlace {
  CellId id;
  DescribedPlace place;
};

/// More CELLs than this are first compared with every second view alone.
constexpr std::size_t kCompareAll = 2'000;
/// Of them, so many are then compared by all.
constexpr std::size_t kShortlist = 1'000;

/// Of the CELLs in `regions`, the `count` that agree best with the query at any turn and from any
/// of its centres, best first, equal ones by id. Fans out over the parts, of which at most
/// `threads` are in use at a time, and merges: the answer depends neither on what lies in which
/// part nor on the threads. Every CELL is compared, in 2 us (first) to 4 us on one thread with
/// AVX2. Nearest-neighbour libraries need a vector that does not change with the heading, and such
/// vectors lose the place once a part of the view is missing (ARCHITECTURE.md, "Relocalisation").
std::vector<AlikePlace> most_alike(const DescribedQuery& query, const PlaceRegions& regions,
                                   const PlaceParts& parts, std::size_t count, int threads);

}  // namespace cellmap
