#include "bench/paper_way.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <nanoflann.hpp>
#include <optional>
#include <random>

#include "cellmap/core/parallel.hpp"

namespace cellmap::bench {
namespace {

constexpr std::size_t kPointsAChunk = 8'192;
constexpr std::size_t kPatchesAChunk = 512;
constexpr double kMaxGapM = 3.0;
constexpr std::size_t kMinPoints = 6;
constexpr int kDraws = 30;
constexpr float kPlaneInlierM = 0.1f;
constexpr double kInlierM = 0.2;

using Group = std::vector<Eigen::Vector3f>;

struct DirectionCloud {
  const std::vector<Eigen::Vector3f>& directions;

  std::size_t kdtree_get_point_count() const { return directions.size(); }
  float kdtree_get_pt(std::size_t index, std::size_t axis) const {
    return directions[index][static_cast<Eigen::Index>(axis)];
  }
  template <typename Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

bool has_gap(const Group& group) {
  std::vector<float> ranges;
  ranges.reserve(group.size());
  for (const Eigen::Vector3f& p : group) ranges.push_back(p.norm());
  std::sort(ranges.begin(), ranges.end());
  for (std::size_t i = 1; i < ranges.size(); ++i) {
    if (ranges[i] - ranges[i - 1] > kMaxGapM) return true;
  }
  return false;
}

struct DrawnPlane {
  Eigen::Vector3f normal = Eigen::Vector3f::Zero();
  float offset = 0;

  bool agrees(const Eigen::Vector3f& p) const {
    return std::abs(normal.dot(p) - offset) < kPlaneInlierM;
  }
};

DrawnPlane best_drawn_plane(const Group& group, std::minstd_rand& random) {
  DrawnPlane best;
  std::ptrdiff_t most = 0;
  std::uniform_int_distribution<std::size_t> draw(0, group.size() - 1);
  for (int i = 0; i < kDraws; ++i) {
    const Eigen::Vector3f &a = group[draw(random)], &b = group[draw(random)],
                          &c = group[draw(random)];
    DrawnPlane plane;
    plane.normal = (b - a).cross(c - a);
    const float length = plane.normal.norm();
    if (!(length > 1e-9f)) continue;
    plane.normal /= length;
    plane.offset = plane.normal.dot(a);
    const auto inliers = std::count_if(group.begin(), group.end(),
                                       [&](const Eigen::Vector3f& p) { return plane.agrees(p); });
    if (inliers > most) {
      most = inliers;
      best = plane;
    }
  }
  return best;
}

/// RANSAC, least squares over the inliers, then the distance along the lattice direction.
std::optional<Plane> extract_plane(const Group& group, const Eigen::Vector3f& direction,
                                   std::minstd_rand& random) {
  const DrawnPlane drawn = best_drawn_plane(group, random);
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  double count = 0;
  for (const Eigen::Vector3f& p : group) {
    if (!drawn.agrees(p)) continue;
    const Eigen::Vector3d q = p.cast<double>();
    sum += q;
    squares += q * q.transpose();
    ++count;
  }
  if (count < 3) return std::nullopt;
  const Eigen::Vector3d mean = sum / count;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(squares / count - mean * mean.transpose());
  Eigen::Vector3d normal = eigen.eigenvectors().col(0);
  const Eigen::Vector3d ray = direction.cast<double>();
  if (normal.dot(ray) > 0) normal = -normal;
  const double distance = normal.dot(mean) / normal.dot(ray);
  if (!(distance > 0) || !std::isfinite(distance)) return std::nullopt;
  return Plane{static_cast<float>(distance), static_cast<float>(normal.x()),
               static_cast<float>(normal.y()), static_cast<float>(normal.z())};
}

/// A point with the plane that its direction meets.
struct Correspondence {
  Eigen::Vector3d point;     // scan's frame
  Eigen::Vector3d normal;    // CELL's frame
  Eigen::Vector3d on_plane;  // d_j * p_j
};

struct Motion {
  Eigen::Matrix3d R;
  Eigen::Vector3d t;

  Motion(const PaperTerm& term, const Pose& T) {
    const Pose moved = term.reverse ? T.inverse() : T;
    R = moved.linear();
    t = moved.translation();
  }
};

/// Correspondences of the whole scan: one growing list a thread.
using Correspondences = std::vector<std::vector<Correspondence>>;

std::size_t points_a_list(const PaperTerm& term, int threads) {
  const std::size_t lists = static_cast<std::size_t>(std::max(threads, 1));
  return std::max<std::size_t>((term.scan->size() + lists - 1) / lists, 1);
}

std::vector<Correspondence> correspondences(const PaperTerm& term, const LatticeTree& tree,
                                            const Motion& motion, std::size_t begin,
                                            std::size_t end) {
  std::vector<Correspondence> found;
  for (std::size_t i = begin; i < end; ++i) {
    const Eigen::Vector3d point = (*term.scan)[i].cast<double>();
    const Eigen::Vector3d moved = motion.R * point + motion.t;
    const std::uint32_t index = tree.nearest(moved.cast<float>());
    const Plane& plane = term.cell->planes[index];
    const Eigen::Vector3d normal(plane.nx, plane.ny, plane.nz);
    if (normal.isZero(0)) continue;
    found.push_back({point, normal, plane.distance_m * tree.direction(index).cast<double>()});
  }
  return found;
}

Correspondences correspondences(const PaperTerm& term, const LatticeTree& tree,
                                const Motion& motion, int threads) {
  const std::size_t points = points_a_list(term, threads);
  Correspondences lists((term.scan->size() + points - 1) / points);
  parallel_for(term.scan->size(), points, threads, [&](std::size_t begin, std::size_t end) {
    lists[begin / points] = correspondences(term, tree, motion, begin, end);
  });
  return lists;
}

template <JacobianSize size>
struct Matrices;
template <>
struct Matrices<JacobianSize::kDynamic> {
  using PointJacobian = Eigen::MatrixXd;
  using Jacobian = Eigen::MatrixXd;
  using Normal = Eigen::MatrixXd;
  using Gradient = Eigen::VectorXd;
};
template <>
struct Matrices<JacobianSize::kFixed> {
  using PointJacobian = Eigen::Matrix<double, 3, 6>;
  using Jacobian = Eigen::Matrix<double, 1, 6>;
  using Normal = Matrix6d;
  using Gradient = Tangent;
};

struct System {
  Matrix6d H = Matrix6d::Zero();
  Tangent g = Tangent::Zero();
};

/// Eq. 1 to 5 for every correspondence.
template <JacobianSize size>
System system_of(const std::vector<Correspondence>& list, bool reverse, const Motion& motion,
                 double gate_m) {
  typename Matrices<size>::Normal H = Matrix6d::Zero();
  typename Matrices<size>::Gradient g = Tangent::Zero();
  for (const Correspondence& c : list) {
    const Eigen::Vector3d moved = motion.R * c.point + motion.t;
    const double distance = c.normal.dot(moved - c.on_plane);
    if (std::abs(distance) > gate_m) continue;
    typename Matrices<size>::PointJacobian J_p(3, 6);
    if (reverse) {
      J_p.template leftCols<3>() = -motion.R;
      J_p.template rightCols<3>() = motion.R * skew(c.point);
    } else {
      J_p.template leftCols<3>() = Eigen::Matrix3d::Identity();
      J_p.template rightCols<3>() = -skew(moved);
    }
    const typename Matrices<size>::Jacobian J = c.normal.transpose() * J_p;
    H += J.transpose() * J;
    g += J.transpose() * distance;
  }
  return {H, g};
}

/// As the paper times it: first the correspondences of all points, then the pose from their list.
System system_of(const PaperTerm& term, const LatticeTree& tree, const Pose& T,
                 const PaperRegistration& options) {
  const Motion motion(term, T);
  const Correspondences lists = correspondences(term, tree, motion, options.threads);
  std::vector<System> chunks(lists.size());
  parallel_for(lists.size(), 1, options.threads, [&](std::size_t chunk, std::size_t) {
    chunks[chunk] =
        options.jacobians == JacobianSize::kDynamic
            ? system_of<JacobianSize::kDynamic>(lists[chunk], term.reverse, motion, options.gate_m)
            : system_of<JacobianSize::kFixed>(lists[chunk], term.reverse, motion, options.gate_m);
  });
  System sum;
  for (const System& chunk : chunks) {
    sum.H += chunk.H;
    sum.g += chunk.g;
  }
  return sum;
}

}  // namespace

struct LatticeTree::Tree {
  using Metric = nanoflann::L2_Simple_Adaptor<float, DirectionCloud>;
  DirectionCloud cloud;
  nanoflann::KDTreeSingleIndexAdaptor<Metric, DirectionCloud, 3, std::uint32_t> index;

  Tree(const std::vector<Eigen::Vector3f>& directions, std::size_t leaf_size)
      : cloud{directions}, index(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(leaf_size)) {
    index.buildIndex();
  }
};

LatticeTree::LatticeTree(const Lattice& lattice, std::size_t leaf_size) {
  directions_.reserve(lattice.size());
  for (std::uint32_t i = 0; i < lattice.size(); ++i) {
    directions_.push_back(lattice.direction(i).cast<float>());
  }
  tree_ = std::make_unique<Tree>(directions_, leaf_size);
}

LatticeTree::~LatticeTree() = default;

std::uint32_t LatticeTree::nearest(const Eigen::Vector3f& point) const {
  const Eigen::Vector3f unit = point.normalized();
  std::uint32_t index = 0;
  float squared_distance = 0;
  nanoflann::KNNResultSet<float, std::uint32_t> result(1);
  result.init(&index, &squared_distance);
  tree_->index.findNeighbors(result, unit.data(), nanoflann::SearchParams());
  return index;
}

void LatticeTree::nearest(const PointCloud& cloud, std::span<std::uint32_t> indices,
                          int threads) const {
  parallel_for(cloud.size(), kPointsAChunk, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) indices[i] = nearest(cloud[i]);
  });
}

std::size_t PaperCell::valid() const {
  return static_cast<std::size_t>(std::count_if(planes.begin(), planes.end(), [](const Plane& p) {
    return p.nx != 0 || p.ny != 0 || p.nz != 0;
  }));
}

PaperCell to_paper_cell(const Cell& cell) {
  PaperCell result;
  result.planes.resize(cell.lattice.size);
  for (std::size_t k = 0; k < cell.planes.size(); ++k) {
    result.planes[cell.indices[k]] = cell.planes[k];
  }
  return result;
}

PaperCell build_cell_paper_way(const PointCloud& local_map, const LatticeTree& tree, int threads) {
  std::vector<std::uint32_t> indices(local_map.size());
  tree.nearest(local_map, indices, threads);
  std::vector<Group> groups(tree.size());
  for (std::size_t i = 0; i < local_map.size(); ++i) groups[indices[i]].push_back(local_map[i]);

  PaperCell cell;
  cell.planes.resize(tree.size());
  parallel_for(groups.size(), kPatchesAChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::minstd_rand random(static_cast<std::uint32_t>(begin + 1));
    for (std::size_t j = begin; j < end; ++j) {
      if (groups[j].size() < kMinPoints || has_gap(groups[j])) continue;
      const auto plane =
          extract_plane(groups[j], tree.direction(static_cast<std::uint32_t>(j)), random);
      if (plane) cell.planes[j] = *plane;
    }
  });
  return cell;
}

Pose register_paper_way(std::span<const PaperTerm> terms, const LatticeTree& tree,
                        const Pose& T_initial, const PaperRegistration& options) {
  Pose T = T_initial;
  for (int i = 0; i < options.iterations; ++i) {
    System sum;
    for (const PaperTerm& term : terms) {
      const System system = system_of(term, tree, T, options);
      sum.H += system.H;
      sum.g += system.g;
    }
    T = exp(Tangent(-sum.H.ldlt().solve(sum.g))) * T;
  }
  return T;
}

double inlier_ratio_paper_way(const PaperTerm& term, const LatticeTree& tree, const Pose& T,
                              int threads) {
  const Motion motion(term, T);
  std::atomic<std::size_t> inliers = 0;
  parallel_for(term.scan->size(), kPointsAChunk, threads, [&](std::size_t begin, std::size_t end) {
    std::size_t near = 0;
    for (const Correspondence& c : correspondences(term, tree, motion, begin, end)) {
      const double distance = c.normal.dot(motion.R * c.point + motion.t - c.on_plane);
      near += std::abs(distance) < kInlierM ? 1 : 0;
    }
    inliers += near;
  });
  return static_cast<double>(inliers) / static_cast<double>(term.scan->size());
}

}  // namespace cellmap::bench
