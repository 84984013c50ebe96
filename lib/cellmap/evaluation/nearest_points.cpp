#include "cellmap/evaluation/nearest_points.hpp"

#include <array>
#include <nanoflann.hpp>
#include <vector>

namespace cellmap {
namespace {

/// The cloud as nanoflann wants to see it.
struct Points {
  const PointCloud& cloud;
  std::size_t kdtree_get_point_count() const { return cloud.size(); }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return axis == 0 ? cloud.x[i] : axis == 1 ? cloud.y[i] : cloud.z[i];
  }
  template <typename Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Metric = nanoflann::L2_Simple_Adaptor<float, Points>;
using Tree = nanoflann::KDTreeSingleIndexAdaptor<Metric, Points, 3, std::uint32_t>;
constexpr std::size_t kLeafSize = 16;

}  // namespace

struct NearestPoints::Impl {
  explicit Impl(const PointCloud& cloud)
      : points{cloud}, tree(3, points, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafSize)) {}
  Points points;
  Tree tree;
};

NearestPoints::NearestPoints(const PointCloud& points) : impl_(std::make_unique<Impl>(points)) {}
NearestPoints::~NearestPoints() = default;
NearestPoints::NearestPoints(NearestPoints&&) noexcept = default;

NearestPoints::Neighbour NearestPoints::nearest(const Eigen::Vector3f& p) const {
  Neighbour found;
  nanoflann::KNNResultSet<float, std::uint32_t> result(1);
  result.init(&found.index, &found.squared_distance_m2);
  impl_->tree.findNeighbors(result, p.data(), nanoflann::SearchParams());
  return found;
}

std::size_t NearestPoints::nearest(const Eigen::Vector3f& p, std::span<Neighbour> found) const {
  std::vector<std::uint32_t> indices(found.size());
  std::vector<float> squared(found.size());
  nanoflann::KNNResultSet<float, std::uint32_t> result(found.size());
  result.init(indices.data(), squared.data());
  impl_->tree.findNeighbors(result, p.data(), nanoflann::SearchParams());
  for (std::size_t k = 0; k < result.size(); ++k) found[k] = {indices[k], squared[k]};
  return result.size();
}

}  // namespace cellmap
