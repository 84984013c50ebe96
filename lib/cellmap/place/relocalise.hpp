#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "cellmap/core/id.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/place/surroundings.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// What is known of the answer beforehand.
struct PosePrior {
  Pose T_map_scan = Pose::Identity();
  double radius_m = 10.0;       ///< the true position is within this of the prior
  double yaw_range_rad = 0.35;  ///< and the true yaw within this
};

/// The prior of a pose that is known with a covariance of exp(xi) * T_map_scan: what lies within
/// `sigmas` standard deviations, at least 1 m and 5 deg. Throws Error{kInvalidArgument} where the
/// pose is not rigid or the covariance is not finite and positive on its diagonal.
PosePrior prior_from_covariance(const Pose& T_map_scan, const Matrix6d& covariance,
                                double sigmas = 3.0);

/// What is asked for: points around one position, and what is known of it.
struct RelocalisationQuery {
  /// Roughly z up (10 deg); seen from about the origin, so that what is near hides what is far.
  PointCloud points;
  /// Unit normals of the surfaces that the points lie on, of either sign and as many as points;
  /// empty: not compared.
  PointCloud normals;
  std::optional<PosePrior> prior;

  /// One scan, in its sensor frame; points that are not finite, or the origin, are ignored.
  static RelocalisationQuery from_scan(PointCloud scan);
  /// Several scans with their odometry, stacked; the answer is the pose of the last one.
  static RelocalisationQuery from_scans(std::span<const PosedScan> scans);
  /// A CELL that was built elsewhere; the answer is the pose of the CELL.
  static RelocalisationQuery from_cell(const Cell& cell, const Lattice& lattice);
};

struct RelocaliseOptions {
  std::size_t shortlist = 250;      ///< with a prior: CELLs near it whose alignments are looked at
  std::size_t candidates = 30;      ///< places most like the query that registration may try
  std::size_t starts = 6;           ///< alignments tried at each, on `screen_points`
  std::size_t searched = 2;         ///< at each, the best that go on to `search_points`
  std::size_t alternatives = 3;     ///< rejected or second-best answers reported
  std::size_t screen_points = 600;  ///< of the query, for each start; about 0.05 ms
  std::size_t search_points = 3'000;  ///< as in PoseSearchOptions
  std::size_t refine_points = 30'000;
  /// A place is believed where its registration passes this and holds every motion (not
  /// degenerate; a prior may hold what the scene does not), with at least this confidence, and,
  /// where there are no CELLs around to ask, below 0.995 and without a prior, where query and CELL
  /// look alike from above too.
  AcceptanceOptions acceptance = searched_place_acceptance();
  double min_confidence = 0.9;
  RegistrationOptions registration = default_place_registration();
  int threads = 1;  ///< 0: all. The answer does not depend on it.

  void validate() const;
  Effort effort() const { return {threads, registration.give_way}; }
  PoseSearchOptions search() const;
};

/// How far the points of a query lie from the planes that they meet; positive in front of them.
struct ResidualHistogram {
  static constexpr std::array<double, 11> kBordersM = {-1.0, -0.5, -0.2, -0.1, -0.05, 0.0,
                                                       0.05, 0.1,  0.2,  0.5,  1.0};
  /// Of points below the first border, between neighbouring ones and from the last on.
  std::array<std::uint32_t, kBordersM.size() + 1> points{};
};

/// One place tried.
struct RelocalisationCandidate {
  CellId cell;
  Pose T_map_scan = Pose::Identity();
  Pose T_cell_scan = Pose::Identity();
  RegistrationResult registration;
  double similarity = 0;            ///< of what query and CELL look like from above, in [-1, 1]
  StructureScores structure;        ///< of the few places that were refined
  ResidualHistogram residuals;      ///< of them too
  SurroundingsScores surroundings;  ///< of the best of them
  /// In [0, 1], that the pose is right: `confidence_of`; of the best one divided by one plus the
  /// odds of its rivals (`odds_against`).
  double confidence = 0;
  bool accepted = false;
};

/// "Here", with the evidence, or an honest "not found" with the best rejected places.
struct RelocalisationAnswer {
  std::optional<RelocalisationCandidate> found;
  Matrix6d covariance = Matrix6d::Zero();  ///< of exp(xi) * T_map_scan; set where found
  std::vector<RelocalisationCandidate> alternatives;
  std::size_t cells_considered = 0;
};

class PlaceRegions;
class PlaceSearcher;

/// Finds a scan in a map. Holds one descriptor a CELL (no scans, no planes), or has them searched
/// by region. Not thread safe while changing; `relocalise` may run on many threads at once.
class PlaceIndex {
 public:
  /// Holds the descriptors of the CELLs that are added.
  PlaceIndex();
  /// Of the CELLs in `regions`, among which `searcher` finds those most like a query; `relocalise`
  /// is to be handed the graph that the regions were made of. Nothing can be added or removed.
  PlaceIndex(std::shared_ptr<const PlaceRegions> regions,
             std::shared_ptr<const PlaceSearcher> searcher);
  ~PlaceIndex();
  PlaceIndex(PlaceIndex&&) noexcept;
  PlaceIndex& operator=(PlaceIndex&&) noexcept;

  /// Computes and keeps the descriptor of a CELL; replaces an earlier one of the same id.
  void add(CellId id, const Cell& cell, const Lattice& lattice);
  void remove(CellId id);
  std::size_t size() const;

  /// Likeness of what both show from above, from 25 points around the scan, orders the places;
  /// registration on few points orders them anew, and the best are registered with many and
  /// accepted only where the scores agree and the CELLs around confirm them. The most alike places
  /// are tried first: a certain answer among them ends the search. With a prior, only CELLs near it
  /// are tried (of an index in parts, only the regions within reach are asked for), from a grid of
  /// poses over all that it allows too, and no answer lies outside it. A scan that looks along the
  /// horizontal within a few degrees is expected. `scan` in its sensor frame, `graph` gives the
  /// current poses of the CELLs in the index, `targets` loads the few that are registered to and
  /// the six nearest to each answer.
  RelocalisationAnswer relocalise(const PointCloud& scan, const PoseGraph& graph,
                                  const TargetProvider& targets,
                                  const std::optional<PosePrior>& prior,
                                  const RelocaliseOptions& options) const;

  /// The same for any query.
  RelocalisationAnswer relocalise(const RelocalisationQuery& query, const PoseGraph& graph,
                                  const TargetProvider& targets,
                                  const RelocaliseOptions& options = {}) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
