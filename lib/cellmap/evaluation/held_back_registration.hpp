#pragma once

#include "cellmap/evaluation/comparison.hpp"

namespace cellmap {

/// How far held-back scans end from where they were taken: medians over those that did not fail,
/// NaN where all did.
struct HeldBackErrors {
  double points_m = 0;  ///< mean displacement of a scan's points
  double origin_m = 0;  ///< displacement of the sensor
  double turn_deg = 0;
  std::size_t registrations = 0, failed = 0;
};

/// Registers every held-back scan from every start (ComparisonOptions). Starts depend on the seed
/// and the scan's number alone, so all maps are asked the same.
HeldBackErrors register_held_back(const ComparedDrive& drive, const DecodedMap& map,
                                  const ComparisonOptions& options);

}  // namespace cellmap
