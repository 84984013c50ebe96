#pragma once

#include "cellmap/registration/registration.hpp"

namespace cellmap {

/// How well a scan agrees with what stands upright. The ground is much the same everywhere and
/// gives most of the points, so the scores of a registration are high at any place with a road;
/// these count only points that hit a plane steeper than 45 deg, or lie more than 0.5 m off a level
/// one.
struct StructureScores {
  std::uint32_t points = 0;  ///< that count
  double inlier_ratio = 0;   ///< of them, within 0.2 m of the plane
  double share_in_front =
      0;  ///< of them, more than 1 m nearer than the plane: its sight line is blocked
};

/// Serial; about 0.1 us a point.
StructureScores score_structure(const RegistrationTarget& target, const PointCloud& scan,
                                const Pose& T_cell_scan);

/// When a pose at a place that was searched for is believed, beside the registration's own tests.
/// Right places had ratios of 0.55 to 0.93 and at most 0.061 in front (KITTI 00 keyframes, thinned
/// scans on a lattice of 20,000, and a simulated town with other cars); wrong ones ratios up to
/// 0.59 but at least 0.074 in front: neither test suffices alone, and the sample is small.
struct StructureAcceptance {
  std::uint32_t min_points = 50;
  double min_inlier_ratio = 0.5;
  double max_share_in_front = 0.07;

  /// Throws Error{kInvalidArgument} where a share is not within 0 and 1.
  void validate() const;
};

bool is_acceptable(const StructureScores& scores, const StructureAcceptance& options);

/// What a registration at a searched place must reach: the sight line must be free (FINDINGS
/// section 4: right places 0.005 in front, wrong ones 0.009 and more on full scans; thinned ones
/// 0.011 and 0.032).
AcceptanceOptions default_place_acceptance();

/// A millimetre is convergence enough for a place, and thin scans do not settle closer.
RegistrationOptions default_place_registration();

}  // namespace cellmap
