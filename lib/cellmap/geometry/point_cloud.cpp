#include "cellmap/geometry/point_cloud.hpp"

#include <algorithm>

namespace cellmap {

PointCloud transformed(const PointCloud& cloud, const Pose& T_target_source) {
  PointCloud moved;
  const std::size_t count = cloud.size();
  moved.x.resize(count);
  moved.y.resize(count);
  moved.z.resize(count);
  const Eigen::Matrix3d R = T_target_source.linear();
  const Eigen::Vector3d t = T_target_source.translation();
  const auto row = [&](int r, std::vector<float>& to) {
    const double rx = R(r, 0), ry = R(r, 1), rz = R(r, 2), shift = t[r];
    for (std::size_t i = 0; i < count; ++i) {
      to[i] = static_cast<float>(rx * cloud.x[i] + ry * cloud.y[i] + rz * cloud.z[i] + shift);
    }
  };
  row(0, moved.x);
  row(1, moved.y);
  row(2, moved.z);
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
