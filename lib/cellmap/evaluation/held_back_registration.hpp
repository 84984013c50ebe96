#pragma once

#include "cellmap/evaluation/comparison.hpp"

namespace cellmap {

/// How far held-back scans end from where they were taken; NaN where none was registered.
struct HeldBackErrors {
  double median_m = 0, median_deg = 0;  ///< of those that did not fail
  std::size_t registrations = 0, failed = 0;
};

/// Registers every held-back scan from every start (ComparisonOptions). Starts depend on the seed
/// and the scan's number alone, so all maps are asked the same.
HeldBackErrors register_held_back(const ComparedDrive& drive, const DecodedMap& map,
                                  const ComparisonOptions& options);

}  // namespace cellmap
