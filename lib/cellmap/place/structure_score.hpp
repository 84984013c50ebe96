#pragma once

#include <functional>

#include "cellmap/place/scan_view.hpp"
#include "cellmap/place/surroundings.hpp"
#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// With fewer CELLs around a pose than this, its own among them, they are no second opinion.
constexpr std::uint32_t kFewestAround = 3;

/// How well a scan and a CELL agree about what stands upright. The ground is much the same
/// everywhere and gives most of the points, so the scores of a registration are high at any place
/// with a road.
///
/// Forward, seen from the CELL: points of the scan that hit a plane steeper than 45 deg, or lie
/// more than 0.5 m off a level one. Reverse, seen from the scan: planes of the CELL steeper than 45
/// deg in directions in which the scan has points. Both sight lines must be free: what stands in
/// the other's free space was not there.
struct StructureScores {
  std::uint32_t points = 0;    ///< of the scan that count
  double inlier_ratio = 0;     ///< of them, within 0.2 m of the plane
  double share_in_front = 0;   ///< of them, more than 1 m nearer than the plane
  std::uint32_t planes = 0;    ///< of the CELL that the scan looks at
  double confirmed_ratio = 0;  ///< of them, with a point of the scan at their range (0.5 m or 5 %)
  double share_seen_through = 0;  ///< of them, nearer than every point by over 1 m and 10 %
  /// Of them: a point of the scan in their direction lies within 0.1 m of the plane. Right places
  /// agree to centimetres, wrong ones by chance.
  double tight_ratio = 0;
  /// Of those of them that no point of the scan hides, the same.
  double visible_tight_ratio = 0;
  /// A second opinion, from normals that the query brings: its upright surfaces in directions in
  /// which the CELL has a plane, and the share of them within 0.3 m of it that face the same way
  /// within 25 deg. 0 where normals were not compared.
  std::uint32_t surfaces = 0;
  double facing_ratio = 0;
};

/// Serial; about 0.1 us a point and a plane.
StructureScores score_structure(const RegistrationTarget& target, const PointCloud& scan,
                                const Pose& T_cell_scan);

/// The same for a scan that is asked often.
StructureScores score_structure(const RegistrationTarget& target, const ScanView& scan,
                                const Pose& T_cell_scan);

/// Points of a scan that hit an upright plane, or lie off a level one.
struct StructurePoints {
  std::uint32_t points = 0, inliers = 0, in_front = 0;  ///< as in StructureScores
};
StructurePoints structure_points(const RegistrationTarget& target, const PointCloud& scan,
                                 const Pose& T_cell_scan);

/// Visits, of every `step`-th plane of the CELL, those steeper than 45 deg in whose directions the
/// scan has points: where it is in the frame of the scan, and what the scan says of it.
void look_at_upright_planes(
    const RegistrationTarget& target, const ScanView& scan, const Pose& T_cell_scan,
    std::size_t step, const std::function<void(const Eigen::Vector3f&, const PlaneSeen&)>& visit);

/// `tight_ratio` of a third of the planes: a tenth of the cost of registering as many points. 0
/// where there are too few.
double quick_tight_ratio(const RegistrationTarget& target, const ScanView& scan,
                         const Pose& T_cell_scan);

/// Surfaces of a scan that stand upright: points with the unit normals of what they lie on.
struct UprightSurfaces {
  PointCloud points, normals;  ///< as many of both
};

/// Sets `surfaces` and `facing_ratio`: a second opinion on a pose for queries that bring normals of
/// their own, as a CELL does. Those of one scan are not worth fitting: with a fifth of its points
/// on clutter few patches keep a plane, and right places then look like wrong ones (0.04 against
/// 0.28 in the median), while `tight_ratio`, which measures along the normals of the CELL alone,
/// still tells them apart. Serial; about 0.1 us a surface.
void score_facing(const RegistrationTarget& target, const UprightSurfaces& surfaces,
                  const Pose& T_cell_scan, StructureScores& scores);

/// One number to order places by: the lesser of the two agreements.
double agreement(const StructureScores& scores);

/// What the structure at a place must reach. The defaults are those of loop closures, whose guess
/// and reverse registration are tested too.
struct StructureAcceptance {
  std::uint32_t min_points = 50;
  double min_inlier_ratio = 0.5;
  double max_share_in_front = 0.07;
  double min_confirmed_ratio = 0.55;
  double max_share_seen_through = 0.3;

  /// Throws Error{kInvalidArgument} where a share is not within 0 and 1.
  void validate() const;
};

bool is_acceptable(const StructureScores& scores, const StructureAcceptance& options);

/// How probable it is that a place that was searched for without a guess is right, in [0, 1].
///
/// A logistic function of how much of the upright structure that the scan looks at it confirms to
/// 0.1 m, of all planes and of those that nothing hides, and of the logarithm of how well the scene
/// holds the weakest motion (`Degeneracy::weakest_share`, of at most 0.06): wrong places agree
/// where a street looks the same for a long way. Fitted by maximum likelihood (ridge 1) to the
/// 4,163 candidates that were refined for 570 queries of two simulated cities (`evaluate
/// relocalisation --seed 101` and `102`) and for every second loop query of KITTI 00. Held out and
/// checked: other simulated cities, the other loop queries, MulRan (OS1-64) and a Livox Avia; the
/// verb prints how often answers of a confidence are right.
double confidence_of(const StructureScores& scores, double weakest_share);
/// The same where the CELLs around were asked too: their odds are added to the CELL's own, none at
/// an `agreement` of 0.68, midway between right poses and wrong ones of the simulated cities 101 to
/// 103 and of the loop queries of KITTI 00 (0.65 and above; 0.60 and below, but for six of 219 that
/// their own CELL speaks against). Where fewer than 12 parts of the view can be judged
/// they can only raise doubt: a narrow view shows one wall to many CELLs. With fewer than
/// `kFewestAround` CELLs, the CELL's own confidence.
double confidence_of(const StructureScores& scores, const SurroundingsScores& surroundings,
                     double weakest_share);
/// The odds of another pose against a pose, by the CELLs around each; 0 where the other was asked
/// of fewer than `kFewestAround`.
double odds_against(const SurroundingsScores& pose, const SurroundingsScores& other);

/// What the registration at such a place must reach beside it: little. A fifth of a scan may lie on
/// people and cars that the CELL does not know; the confidence knows them from walls.
AcceptanceOptions searched_place_acceptance();

/// What the registration at a searched place must reach: the sight line must be free.
AcceptanceOptions default_place_acceptance();

/// A millimetre is convergence enough for a place, and thin scans do not settle closer.
RegistrationOptions default_place_registration();

}  // namespace cellmap
