#include "cellmap/geometry/point_cloud.hpp"

#include <algorithm>

namespace cellmap {

PointCloud transformed(const PointCloud& cloud, const Pose& T_target_source) {
  PointCloud moved;
  moved.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    moved.push_back((T_target_source * cloud[i].cast<double>()).cast<float>());
  }
  return moved;
}

PointCloud every_nth(const PointCloud& cloud, std::size_t step) {
  step = std::max<std::size_t>(step, 1);
  PointCloud thinned;
  thinned.reserve(cloud.size() / step + 1);
  for (std::size_t i = 0; i < cloud.size(); i += step) thinned.push_back(cloud[i]);
  return thinned;
}

}  // namespace cellmap
