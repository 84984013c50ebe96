#pragma once

#include "cellmap/cell/plane_fit.hpp"
#include "cellmap/cell/point_runs.hpp"
#include "cellmap/cell/range_gap.hpp"

namespace cellmap {

/// All that PlaneFit::kMoments keeps of the points of a patch. Points are added one after the
/// other, each rounded, so the sums depend on nothing but their order.
class PatchSums {
 public:
  void add(const PointCloud& cloud, const PointRun& run, double max_range_gap_m);

  std::uint32_t points() const { return static_cast<std::uint32_t>(about_.moments.count); }
  const MomentsAbout& moments() const { return about_; }  ///< about the first point
  const RangeClusters& ranges() const { return ranges_; }

 private:
  MomentsAbout about_;
  RangeClusters ranges_;
};

}  // namespace cellmap
