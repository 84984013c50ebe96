#pragma once

#include "cellmap/registration/registration.hpp"

namespace cellmap {

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
};

/// Serial; about 0.1 us a point and a plane.
StructureScores score_structure(const RegistrationTarget& target, const PointCloud& scan,
                                const Pose& T_cell_scan);

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

/// When a place that was searched for without a guess is believed by itself: both sight lines free.
/// Over held-back scans of KITTI 00 (full and thinned), MulRan (OS1-64) and a Livox Avia, right
/// places had at most 0.019 in front by registration, 0.054 by structure and 0.062 seen through,
/// and ratios of at least 0.55 and 0.76; each wrong one failed one of the four.
StructureAcceptance clear_structure_acceptance();

/// When it is believed because it beats every other place by far, though things stand in the way
/// that the map does not know, or the other way round (traffic, parked cars).
StructureAcceptance busy_structure_acceptance();
AcceptanceOptions busy_place_acceptance();

/// What the registration at a searched place must reach: the sight line must be free.
AcceptanceOptions default_place_acceptance();

/// A millimetre is convergence enough for a place, and thin scans do not settle closer.
RegistrationOptions default_place_registration();

}  // namespace cellmap
