#pragma once

#include <algorithm>
#include <array>
#include <vector>

#include "cellmap/place/described_place.hpp"

namespace cellmap {

/// Where a query might stand in the frame of a CELL, from what both look like.
struct PlaceAlignment {
  Pose T_cell_query = Pose::Identity();
  double similarity = 0;  ///< of the signatures, in [-1, 1]
};

/// A query as the index is asked for it: its points in their ground frame, described from 25 places
/// around it, 5 x 5 at 2 m, so that one of them is near the origin of any CELL that was passed
/// within 5 m, in whichever lane. Describing the query often and each CELL once keeps the index
/// small. About 3 ms for 20,000 points.
class DescribedQuery {
 public:
  explicit DescribedQuery(const PointCloud& points);

  struct Copy {
    Eigen::Vector2d centre;
    PlaceSignature signature;
  };
  const std::vector<Copy>& copies() const { return copies_; }
  const GroundFrame& ground() const { return ground_; }
  const simd::TurnedViews& views() const { return views_; }
  /// Every second of the views, as on the squares of one colour: enough to leave most CELLs out.
  const simd::TurnedViews& some_views() const { return some_views_; }
  /// Sectors around the query that it has points in; what a place shows elsewhere does not count.
  const std::array<bool, Columns::kSectors>& seen() const { return seen_; }
  bool sees_all() const { return sees_all_; }
  bool is_narrow() const {
    return 2 * std::count(seen_.begin(), seen_.end(), true) < std::ssize(seen_);
  }

 private:
  GroundFrame ground_;
  std::vector<Copy> copies_;
  simd::TurnedViews views_, some_views_;
  std::array<bool, Columns::kSectors> seen_;
  bool sees_all_ = true;
};

/// How much the query looks like a place, at the most similar turn and from the best of its
/// centres, in [-1, 1]; of what both show where the query sees a part of its surroundings. About 4
/// us.
float likeness(const DescribedQuery& query, const DescribedPlace& place);

/// The same of every second view and ten harmonics, as a first look at many places: 2 us.
float first_likeness(const DescribedQuery& query, const DescribedPlace& place);

/// The best alignments with one CELL, best first: for each of the query's copies every local
/// maximum over the heading. About 30 us.
std::vector<PlaceAlignment> align(const DescribedQuery& query, const DescribedPlace& place,
                                  std::size_t count);

}  // namespace cellmap
