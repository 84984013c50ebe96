#pragma once

#include <map>
#include <span>

namespace cellmap {

/// Foreground and background in one patch (paper, Sec. III-B, step 3): whether two neighbours among
/// the sorted ranges are more than `max_gap_m` apart. `ranges_m` lie in [least_m, most_m], the two
/// ends among them, and are sorted where that is needed to tell.
bool has_range_gap(std::span<double> ranges_m, double least_m, double most_m, double max_gap_m);

/// The same while ranges come one by one: clusters of ranges with no such gap inside. They do not
/// depend on the order in which ranges come, so the answer is that of `has_range_gap`.
class RangeClusters {
 public:
  /// Adds ranges in [least_m, most_m], the two ends among them, that are one cluster. Logarithmic
  /// in the number of clusters, which nearly always is one.
  void add(double least_m, double most_m, double max_gap_m);

  bool has_gap() const { return clusters_.size() > 1; }
  double least_m() const { return least_m_; }
  double most_m() const { return most_m_; }

 private:
  void insert(double least_m, double most_m, double max_gap_m);

  double least_m_ = 1, most_m_ = 0;    ///< of all; no range yet where least > most
  std::map<double, double> clusters_;  ///< least to most; empty while all span no more than a gap
};

}  // namespace cellmap
