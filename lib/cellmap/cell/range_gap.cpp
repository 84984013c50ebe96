#include "cellmap/cell/range_gap.hpp"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <iterator>
#include <optional>

namespace cellmap {
namespace {

/// Which of 64 bins of the span hold a range nearly always tells: the largest gap is longer than
/// the longest row of empty bins and shorter than that row with its two neighbours.
std::optional<bool> has_gap_by_bins(std::span<const double> ranges_m, double least_m, double most_m,
                                    double max_gap_m) {
  constexpr int kBins = 64;
  constexpr double kRoundingM = 1e-9;
  const double bins_a_metre = kBins / (most_m - least_m);
  std::uint64_t occupied = 0;
  for (const double range : ranges_m) {
    const int bin = static_cast<int>((range - least_m) * bins_a_metre);
    occupied |= std::uint64_t{1} << std::min(bin, kBins - 1);
  }
  int longest = 0, last = 0;
  for (std::uint64_t rest = occupied & (occupied - 1); rest != 0; rest &= rest - 1) {
    const int bin = std::countr_zero(rest);
    longest = std::max(longest, bin - last - 1);
    last = bin;
  }
  const double bin_m = (most_m - least_m) / kBins;
  if ((longest + 2) * bin_m + kRoundingM <= max_gap_m) return false;
  if (longest * bin_m - kRoundingM > max_gap_m) return true;
  return std::nullopt;
}

}  // namespace

bool has_range_gap(std::span<double> ranges_m, double least_m, double most_m, double max_gap_m) {
  if (!(most_m - least_m > max_gap_m)) return false;
  if (const auto told = has_gap_by_bins(ranges_m, least_m, most_m, max_gap_m)) return *told;
  std::sort(ranges_m.begin(), ranges_m.end());
  for (std::size_t i = 1; i < ranges_m.size(); ++i) {
    if (ranges_m[i] - ranges_m[i - 1] > max_gap_m) return true;
  }
  return false;
}

void RangeClusters::add(double least_m, double most_m, double max_gap_m) {
  const double old_least = least_m_, old_most = most_m_;
  const bool first = old_least > old_most;
  least_m_ = first ? least_m : std::min(least_m, old_least);
  most_m_ = first ? most_m : std::max(most_m, old_most);
  if (clusters_.empty()) {
    if (first || !(most_m_ - least_m_ > max_gap_m)) return;
    clusters_.emplace(old_least, old_most);
  }
  insert(least_m, most_m, max_gap_m);
}

void RangeClusters::insert(double least_m, double most_m, double max_gap_m) {
  auto next = clusters_.lower_bound(least_m);
  if (next != clusters_.begin() && !(least_m - std::prev(next)->second > max_gap_m)) --next;
  while (next != clusters_.end() && !(next->first - most_m > max_gap_m)) {
    least_m = std::min(least_m, next->first);
    most_m = std::max(most_m, next->second);
    next = clusters_.erase(next);
  }
  clusters_.emplace(least_m, most_m);
}

}  // namespace cellmap
