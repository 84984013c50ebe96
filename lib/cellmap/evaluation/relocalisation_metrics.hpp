#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

namespace cellmap {

/// One relocalisation whose true answer is known.
struct RelocalisationTrial {
  bool mapped = true;  ///< the place is in the map; else every accepted answer is wrong
  bool accepted = false;
  double confidence = 0;  ///< of the best candidate, accepted or not
  double error_m = 0;     ///< of the best candidate against the truth; infinite where there is none
  double error_deg = 0;
  double query_ms = 0;    ///< of one thread: its processor time; of more, what passed
  double distance_m = 0;  ///< true distance to the nearest CELL's base
  double lateral_m = 0;   ///< of that, sideways from where the CELL looks, without sign
};

/// An answer farther than this from the truth is wrong.
struct RelocalisationLimits {
  double wrong_m = 1.0;
  double wrong_deg = 3.0;
};

struct MedianAndP95 {
  double median = 0, p95 = 0;
};

/// How a scenario went. Shares are in [0, 1], over the queries whose place is mapped; NaN where
/// there are none.
struct RelocalisationReport {
  std::string scenario;
  std::size_t queries = 0;
  std::size_t mapped = 0;          ///< of them, from places in the map
  std::size_t accepted = 0;        ///< answers that were given, right or wrong
  std::size_t wrong_accepted = 0;  ///< of them, wrong ones
  /// Right answers that were given with a confidence above every wrong one's: what is found once
  /// nothing wrong is believed. Without a wrong answer it is the share of right answers.
  double recall_at_full_precision = 0;
  double recall_at_1 = 0;           ///< the best candidate is right, whether it was accepted or not
  MedianAndP95 error_m, error_deg;  ///< of the right answers; NaN where there are none
  MedianAndP95 query_ms;            ///< of all queries

  /// Right answers among the mapped queries of a range [from, to).
  struct Bin {
    double from_m = 0, to_m = 0;
    std::size_t queries = 0, found = 0;
  };
  std::vector<Bin> by_distance, by_lateral;  ///< ranges without a query are left out

  /// How often the best candidates of a range of confidence [from, to) are right, accepted or not.
  struct Reliability {
    double from = 0, to = 0;
    std::size_t candidates = 0, right = 0;
    double confidence_sum = 0;  ///< over the candidates; right over it is 1 where calibrated
  };
  std::vector<Reliability> reliability;  ///< all ranges
};

/// Sums up the trials of a scenario. O(n log n). `highest_wrong`: confidence of the most believed
/// wrong answer elsewhere that right ones must exceed too, as on the same map.
RelocalisationReport summarise(std::string scenario, std::span<const RelocalisationTrial> trials,
                               const RelocalisationLimits& limits = {}, double highest_wrong = 0);

/// Confidence of the most believed wrong answer; 0 where there is none.
double highest_wrong_confidence(std::span<const RelocalisationTrial> trials,
                                const RelocalisationLimits& limits = {});

/// One JSON object; its keys are the fields' names but the scenario's, NaN is null.
std::string to_json(const RelocalisationReport& report);

/// A table for people, one row a scenario, and the recall by distance and by lateral offset.
std::string to_table(std::span<const RelocalisationReport> reports);

}  // namespace cellmap
