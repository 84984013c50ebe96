#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// What is known of the answer beforehand.
struct PosePrior {
  Pose T_map_scan = Pose::Identity();
  double radius_m = 10.0;       ///< the true position is within this of the prior
  double yaw_range_rad = 0.35;  ///< and the true yaw within this
};

struct RelocaliseOptions {
  std::size_t candidates = 10;        ///< places that go on to registration
  std::size_t starts = 6;             ///< alignments of the images tried at each; about 4 ms each
  std::size_t alternatives = 3;       ///< rejected or second-best answers reported
  std::size_t search_points = 3'000;  ///< as in PoseSearchOptions
  std::size_t refine_points = 30'000;
  /// A place is believed by itself where it passes these two.
  AcceptanceOptions acceptance = default_place_acceptance();
  StructureAcceptance structure = clear_structure_acceptance();
  /// Else the best place is believed where it passes these two and its structure agrees better by
  /// `min_dominance` than that of every place more than 5 m away. Without a prior there must be
  /// such a place to compare with.
  AcceptanceOptions busy_acceptance = busy_place_acceptance();
  StructureAcceptance busy_structure = busy_structure_acceptance();
  double min_dominance = 0.2;
  RegistrationOptions registration = default_place_registration();
  int threads = 1;  ///< 0: all. The answer does not depend on it.

  void validate() const;
  PoseSearchOptions search() const;
};

/// One place tried.
struct RelocalisationCandidate {
  CellId cell;
  Pose T_map_scan = Pose::Identity();
  Pose T_cell_scan = Pose::Identity();
  RegistrationResult registration;
  StructureScores structure;  ///< of the few places that were refined
  bool accepted = false;
};

/// "Here", with the evidence, or an honest "not found" with the best rejected places.
struct RelocalisationAnswer {
  std::optional<RelocalisationCandidate> found;
  Matrix6d covariance = Matrix6d::Zero();  ///< of exp(xi) * T_map_scan; set where found
  std::vector<RelocalisationCandidate> alternatives;
  std::size_t cells_considered = 0;
};

/// Finds a scan in a map. Holds one descriptor a CELL (no scans, no planes). Not thread safe while
/// changing; `relocalise` may run on many threads at once.
class PlaceIndex {
 public:
  PlaceIndex();
  ~PlaceIndex();
  PlaceIndex(PlaceIndex&&) noexcept;
  PlaceIndex& operator=(PlaceIndex&&) noexcept;

  /// Computes and keeps the descriptor of a CELL; replaces an earlier one of the same id.
  void add(CellId id, const Cell& cell, const Lattice& lattice);
  void remove(CellId id);
  std::size_t size() const;

  /// Likeness of polar images from nine re-centred copies of the scan orders the places,
  /// registration on few points orders them anew, and the best are registered with many
  /// and accepted only where the scores agree. With a prior, only CELLs near it are tried, from a
  /// grid of poses over all that it allows too, and no answer lies outside it. A scan that looks
  /// along the horizontal within a few degrees is expected. `scan` in its sensor frame, `graph`
  /// gives the current poses of the CELLs in the index, `targets` loads the few that are registered
  /// to.
  RelocalisationAnswer relocalise(const PointCloud& scan, const PoseGraph& graph,
                                  const TargetProvider& targets,
                                  const std::optional<PosePrior>& prior,
                                  const RelocaliseOptions& options) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
