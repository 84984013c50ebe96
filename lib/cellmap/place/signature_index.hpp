#pragma once

#include <algorithm>
#include <array>
#include <map>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/place/ground.hpp"
#include "cellmap/place/place_signature.hpp"

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

/// The signatures of many CELLs. Not thread safe while changing.
class SignatureIndex {
 public:
  /// Replaces an earlier one of the same id. `points`: of the CELL, in its frame.
  void add(CellId id, const PointCloud& points);
  void remove(CellId id);
  std::size_t size() const { return ids_.size(); }
  const std::map<CellId, std::size_t>& slots() const { return slots_; }
  CellId id(std::size_t slot) const { return ids_[slot]; }
  const GroundFrame& ground(CellId cell) const { return grounds_[slots_.at(cell)]; }

  /// More CELLs than this are first compared with every second view alone.
  static constexpr std::size_t kCompareAll = 2'000;
  /// Of them, so many are then compared by all.
  static constexpr std::size_t kShortlist = 1'000;

  /// Of the CELLs at `slots`, the `count` that agree best with the query at any turn and from any
  /// of its centres, best first. Every CELL is compared: 577 take about 2 ms on
  /// one thread with AVX2, more in proportion. Nearest-neighbour libraries need a vector that does
  /// not change with the heading, and such vectors lose the place once a part of the view is
  /// missing (ARCHITECTURE.md, "Relocalisation").
  std::vector<CellId> most_alike(const DescribedQuery& query, const std::vector<std::size_t>& slots,
                                 std::size_t count, int threads) const;

  /// The best alignments with one CELL, best first: for each of the query's copies every local
  /// maximum over the heading. About 30 us.
  std::vector<PlaceAlignment> align(const DescribedQuery& query, CellId cell,
                                    std::size_t count) const;

 private:
  /// Of the CELLs at `slots`, the `count` best, best first.
  template <typename Likeness>
  std::vector<std::size_t> best_of(const std::vector<std::size_t>& slots, std::size_t count,
                                   int threads, const Likeness& likeness) const;
  float likeness(const DescribedQuery& query, std::size_t slot) const;

  std::map<CellId, std::size_t> slots_;
  std::vector<CellId> ids_;  // by slot
  std::vector<PlaceSignature> signatures_;
  std::vector<GroundFrame> grounds_;
};

}  // namespace cellmap
