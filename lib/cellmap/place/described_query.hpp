#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "cellmap/core/give_way.hpp"
#include "cellmap/place/described_place.hpp"

namespace cellmap {

/// Where a query might stand in the frame of a CELL, from what both look like.
struct PlaceAlignment {
  Pose T_cell_query = Pose::Identity();
  double similarity = 0;  ///< of the signatures, in [-1, 1]
};

/// What places are compared with: a query described from some points around it. Nothing else of the
/// query is needed to search for it, so this is what one server sends to another.
class QueryViews {
 public:
  static constexpr int kSteps = 2;  ///< to each side of the query
  static constexpr std::size_t kSide = 2 * kSteps + 1, kViews = kSide * kSide;
  using Seen = std::array<bool, Columns::kSectors>;

  /// kViews signatures, of the places of a square row by row.
  QueryViews(std::vector<PlaceSignature> signatures, const Seen& seen);

  const std::vector<PlaceSignature>& signatures() const { return signatures_; }
  const simd::TurnedViews& all() const { return all_; }
  /// Every second of them, as on the squares of one colour: enough to leave most CELLs out.
  const simd::TurnedViews& some() const { return some_; }
  /// Sectors around the query that it has points in; what a place shows elsewhere does not count.
  const Seen& seen() const { return seen_; }
  bool sees_all() const { return sees_all_; }

 private:
  std::vector<PlaceSignature> signatures_;
  simd::TurnedViews all_, some_;
  Seen seen_;
  bool sees_all_;
};

/// A query as the index is asked for it: its points in their ground frame, described from 25 places
/// around it, 5 x 5 at 2 m, so that one of them is near the origin of any CELL that was passed
/// within 5 m, in whichever lane. Describing the query often and each CELL once keeps the index
/// small. About 3 ms for 20,000 points.
class DescribedQuery {
 public:
  explicit DescribedQuery(const PointCloud& points, const GiveWay& give_way = {});

  const GroundFrame& ground() const { return ground_; }
  const QueryViews& views() const { return views_; }
  bool is_narrow() const {
    return 2 * std::count(views_.seen().begin(), views_.seen().end(), true) <
           std::ssize(views_.seen());
  }

 private:
  GroundFrame ground_;
  QueryViews views_;
};

/// How much the query looks like a place, at the most similar turn and from the best of its
/// centres, in [-1, 1]; of what both show where the query sees a part of its surroundings. About 4
/// us.
float likeness(const QueryViews& query, const DescribedPlace& place);

/// The same of every second view and ten harmonics, as a first look at many places: 2 us.
float first_likeness(const QueryViews& query, const DescribedPlace& place);

/// The best alignments with one CELL, best first: for each of the query's views every local
/// maximum over the heading. About 30 us.
std::vector<PlaceAlignment> align(const DescribedQuery& query, const DescribedPlace& place,
                                  std::size_t count);

}  // namespace cellmap
