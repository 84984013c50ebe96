#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "cellmap/core/parallel.hpp"
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

/// What is wanted of a search, which may be spread over several searchers: each is told the same.
struct SearchTerms {
  std::size_t count = 0;    ///< places that are wanted
  bool first_look = false;  ///< whether the CELLs, all together, are more than kCompareAll

  std::size_t kept() const;  ///< of the first look, or `count`
};

/// A place that a search kept: one of the best `SearchTerms::kept()` of its CELLs at first look.
struct ComparedPlace {
  CellId id;
  float first = 0;     ///< `first_likeness`, where there is a first look, else `likeness`
  float likeness = 0;  ///< `likeness`
  /// Null where it cannot be among the best: see `may_be_best`.
  std::unique_ptr<const DescribedPlace> place;
};
/// By first look, the most alike first, equal ones by id.
using ComparedPlaces = std::vector<ComparedPlace>;

/// Of places that were kept, those that may be among the best `count` of them and of any others:
/// fewer than that are more alike of those that were no worse at first look. Only their
/// descriptions have to reach who merges.
std::vector<bool> may_be_best(const ComparedPlaces& places, std::size_t count);

/// What searches of different CELLs kept, as one search of all of them would.
ComparedPlaces merged(std::vector<ComparedPlaces> found, const SearchTerms& terms);

using RegionList = std::vector<const PlaceRegions::Region*>;

/// Who compares a query with the CELLs of regions: this process with what it holds, or others.
/// Thread safe.
class PlaceSearcher {
 public:
  virtual ~PlaceSearcher() = default;
  /// Of all CELLs of the regions. The answer depends on them alone.
  virtual ComparedPlaces search(const QueryViews& query, const RegionList& regions,
                                const SearchTerms& terms, const Effort& effort) const = 0;
};

/// Searches the parts of an index, one a thread at a time: what is at hand first.
/// Every CELL is compared, in 2 us (first look) to 4 us on one thread with AVX2. Nearest-neighbour
/// libraries need a vector that does not change with the heading, and such vectors lose the place
/// once a part of the view is missing (ARCHITECTURE.md, "Relocalisation").
class PartsSearcher : public PlaceSearcher {
 public:
  explicit PartsSearcher(std::shared_ptr<const PlaceParts> parts) : parts_(std::move(parts)) {}
  ComparedPlaces search(const QueryViews& query, const RegionList& regions,
                        const SearchTerms& terms, const Effort& effort) const override;

 private:
  std::shared_ptr<const PlaceParts> parts_;
};

/// Of the CELLs in `regions`, the `count` that agree best with the query at any turn and from any
/// of its centres, best first, equal ones by id. The answer depends neither on what lies in which
/// part, nor on who searches it, nor on the threads.
std::vector<AlikePlace> most_alike(const QueryViews& query, const PlaceRegions& regions,
                                   const PlaceSearcher& searcher, std::size_t count,
                                   const Effort& effort);

}  // namespace cellmap
