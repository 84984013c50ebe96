#pragma once

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
/// small. About 4 ms for 20,000 points.
class DescribedQuery {
 public:
  explicit DescribedQuery(const PointCloud& points);

  struct Copy {
    Eigen::Vector2d centre;
    PlaceSignature signature;
    PlaceSignature::Key key;
  };
  const std::vector<Copy>& copies() const { return copies_; }
  const GroundFrame& ground() const { return ground_; }

 private:
  GroundFrame ground_;
  std::vector<Copy> copies_;
};

/// The signatures of many CELLs. Not thread safe while changing.
class SignatureIndex {
 public:
  /// Replaces an earlier one of the same id. `points`: of the CELL, in its frame.
  void add(CellId id, const PointCloud& points);
  void remove(CellId id);
  std::size_t size() const { return ids_.size(); }
  const std::map<CellId, std::size_t>& slots() const { return slots_; }
  const GroundFrame& ground(CellId cell) const { return grounds_[slots_.at(cell)]; }

  /// Of the CELLs at `slots`, the `count` whose keys are most like one of the query's, most alike
  /// first. Every key is compared: 50,000 CELLs take about 25 ms on one thread.
  std::vector<CellId> most_alike(const DescribedQuery& query, const std::vector<std::size_t>& slots,
                                 std::size_t count, int threads) const;

  /// The best alignments with one CELL, best first: for each of the query's copies every local
  /// maximum over the heading. About 30 us.
  std::vector<PlaceAlignment> align(const DescribedQuery& query, CellId cell,
                                    std::size_t count) const;

 private:
  std::map<CellId, std::size_t> slots_;
  std::vector<CellId> ids_;  // by slot
  std::vector<PlaceSignature> signatures_;
  std::vector<GroundFrame> grounds_;
  std::vector<float> keys_;  // kKeySize each
};

}  // namespace cellmap
