#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// Points in metres as a structure of arrays, the layout that the hot loops stream through.
/// The three arrays always have the same length. The frame is stated by whoever owns the cloud.
struct PointCloud {
  std::vector<float> x, y, z;

  std::size_t size() const { return x.size(); }
  bool empty() const { return x.empty(); }
  Eigen::Vector3f operator[](std::size_t i) const { return {x[i], y[i], z[i]}; }
  void push_back(const Eigen::Vector3f& p) {
    x.push_back(p.x());
    y.push_back(p.y());
    z.push_back(p.z());
  }
  void reserve(std::size_t n) {
    x.reserve(n);
    y.reserve(n);
    z.reserve(n);
  }
  void clear() {
    x.clear();
    y.clear();
    z.clear();
  }
  void append(const PointCloud& other) {
    x.insert(x.end(), other.x.begin(), other.x.end());
    y.insert(y.end(), other.y.begin(), other.y.end());
    z.insert(z.end(), other.z.begin(), other.z.end());
  }
};

/// Every point moved by `T`; computed in double, rounded once.
PointCloud transformed(const PointCloud& cloud, const Pose& T_target_source);

/// Every `step`-th point, starting with the first.
PointCloud every_nth(const PointCloud& cloud, std::size_t step);

}  // namespace cellmap
