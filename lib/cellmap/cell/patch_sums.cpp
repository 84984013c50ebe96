#include "cellmap/cell/patch_sums.hpp"

#include <algorithm>
#include <cmath>

namespace cellmap {
namespace {

double squared_range(const PointCloud& cloud, std::size_t i) {
  const double x = cloud.x[i], y = cloud.y[i], z = cloud.z[i];
  return (x * x + y * y) + z * z;
}

}  // namespace

void PatchSums::add(const PointCloud& cloud, const PointRun& run, double max_range_gap_m) {
  if (about_.moments.count == 0) about_.origin = cloud[run.first].cast<double>();
  const double ox = about_.origin.x(), oy = about_.origin.y(), oz = about_.origin.z();
  auto [sx, sy, sz] = about_.moments.sum;
  auto [xx, xy, xz, yy, yz, zz] = about_.moments.products;
  double least2 = HUGE_VAL, most2 = 0;
  const std::size_t end = run.first + run.count;
  for (std::size_t i = run.first; i < end; ++i) {
    const double range2 = squared_range(cloud, i);
    least2 = std::min(least2, range2);
    most2 = std::max(most2, range2);
    const double x = cloud.x[i] - ox, y = cloud.y[i] - oy, z = cloud.z[i] - oz;
    sx += x, sy += y, sz += z;
    xx += x * x, xy += x * y, xz += x * z;
    yy += y * y, yz += y * z, zz += z * z;
  }
  about_.moments = {about_.moments.count + run.count, {sx, sy, sz}, {xx, xy, xz, yy, yz, zz}};

  const double least_m = std::sqrt(least2), most_m = std::sqrt(most2);
  if (!(most_m - least_m > max_range_gap_m)) {
    ranges_.add(least_m, most_m, max_range_gap_m);
    return;
  }
  for (std::size_t i = run.first; i < end; ++i) {
    const double range_m = std::sqrt(squared_range(cloud, i));
    ranges_.add(range_m, range_m, max_range_gap_m);
  }
}

}  // namespace cellmap
