#include "cellmap/registration/residuals.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "cellmap/core/parallel.hpp"

namespace cellmap {
namespace {

/// Fixed, so that sums are formed in the same order on any number of threads.
constexpr std::size_t kPointsAChunk = 8'192;

/// Moves points of one term into its CELL's frame and looks up their planes.
class PointMover {
 public:
  PointMover(const RegistrationTerm& term, const Pose& T)
      : term_(term),
        R_(term.reverse ? Eigen::Matrix3d(T.linear().transpose()) : T.linear()),
        t_(term.reverse ? Eigen::Vector3d(-(R_ * T.translation())) : T.translation()) {}

  struct Hit {
    std::int32_t plane = -1;
    double distance_m = 0;
    Eigen::Vector3d moved;   // the point in the CELL's frame
    Eigen::Vector3d normal;  // of the plane, CELL's frame
  };

  Hit look_up(std::size_t point) const {
    Hit hit;
    const Eigen::Vector3d p = (*term_.scan)[point].cast<double>();
    hit.moved = R_ * p + t_;
    if (!(hit.moved.squaredNorm() > 0)) return hit;  // at the origin there is no direction
    hit.plane = term_.target->plane_of(term_.target->lattice().nearest(hit.moved));
    if (hit.plane < 0) return hit;
    const Plane& plane = term_.target->cell().planes[static_cast<std::size_t>(hit.plane)];
    hit.normal = Eigen::Vector3d(plane.nx, plane.ny, plane.nz);
    hit.distance_m =
        hit.normal.dot(hit.moved) - term_.target->offset(static_cast<std::size_t>(hit.plane));
    return hit;
  }

  /// d distance / d xi. Forward: n^T [I, -[T p]x]. Reverse: -n^T R^-1 [I, -[p]x].
  Tangent jacobian(const Hit& hit, std::size_t point) const {
    Tangent J;
    if (term_.reverse) {
      const Eigen::Vector3d m = -(R_.transpose() * hit.normal);
      J << m, (*term_.scan)[point].cast<double>().cross(m);
    } else {
      J << hit.normal, hit.moved.cross(hit.normal);
    }
    return J;
  }

 private:
  const RegistrationTerm& term_;
  Eigen::Matrix3d R_;
  Eigen::Vector3d t_;
};

double kernel_weight(const RegistrationStage& stage, double distance) {
  const double ratio = distance / stage.kernel_width_m;
  switch (stage.kernel) {
    case RobustKernel::kNone:
      return 1.0;
    case RobustKernel::kCauchy:
      return 1.0 / (1.0 + ratio * ratio);
    case RobustKernel::kGemanMcClure:
      break;
  }
  const double w = 1.0 / (1.0 + ratio * ratio);
  return w * w;
}

/// The upper triangle of H and g of one chunk of points.
struct Sums {
  std::array<double, 21> h{};
  std::array<double, 6> g{};
  std::size_t points = 0;

  void add(const Tangent& J, double weight, double distance) {
    std::size_t k = 0;
    for (int row = 0; row < 6; ++row) {
      const double weighted = weight * J[row];
      g[static_cast<std::size_t>(row)] += weighted * distance;
      for (int col = row; col < 6; ++col) h[k++] += weighted * J[col];
    }
    ++points;
  }

  void add_to(NormalSystem& system) const {
    std::size_t k = 0;
    for (int row = 0; row < 6; ++row) {
      system.g[row] += g[static_cast<std::size_t>(row)];
      for (int col = row; col < 6; ++col) system.H(row, col) += h[k++];
    }
    system.points += points;
  }
};

std::size_t selected_points(const PointCloud& scan, std::size_t step) {
  return (scan.size() + step - 1) / step;
}

/// `selection` with a step so large that no more than `max_points` take part (0: any number).
PointSelection thinned(PointSelection selection, const PointCloud& scan, std::size_t max_points) {
  if (max_points > 0) {
    selection.step = std::max(selection.step, (scan.size() + max_points - 1) / max_points);
  }
  return selection;
}

/// Calls `add(mover, hit, point, sums)` for every point that has a plane and adds up the chunks in
/// order.
template <typename Add>
void sum_over_points(const RegistrationTerm& term, const Pose& T, const PointSelection& selection,
                     NormalSystem& system, const Add& add) {
  const PointMover mover(term, T);
  const std::size_t count = selected_points(*term.scan, selection.step);
  std::vector<Sums> chunks((count + kPointsAChunk - 1) / kPointsAChunk);
  parallel_for(count, kPointsAChunk, selection.threads, [&](std::size_t begin, std::size_t end) {
    Sums& sums = chunks[begin / kPointsAChunk];
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t point = i * selection.step;
      const PointMover::Hit hit = mover.look_up(point);
      if (hit.plane >= 0) add(mover, hit, point, sums);
    }
  });
  for (const Sums& sums : chunks) sums.add_to(system);
}

void mirror(Matrix6d& H) { H.triangularView<Eigen::StrictlyLower>() = H.transpose(); }

}  // namespace

Residual evaluate(const RegistrationTerm& term, const Pose& T, std::size_t point) {
  const PointMover mover(term, T);
  const PointMover::Hit hit = mover.look_up(point);
  if (hit.plane < 0) return {};
  return {hit.plane, hit.distance_m, mover.jacobian(hit, point)};
}

HitDistances hit_distances(const RegistrationTerm& term, const Pose& T,
                           const PointSelection& selection) {
  const PointMover mover(term, T);
  const std::size_t count = selected_points(*term.scan, selection.step);
  std::vector<float> distance_m(count);
  std::vector<std::int32_t> plane(count);
  parallel_for(count, kPointsAChunk, selection.threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const PointMover::Hit hit = mover.look_up(i * selection.step);
      plane[i] = hit.plane;
      distance_m[i] = static_cast<float>(hit.distance_m);
    }
  });
  std::size_t kept = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (plane[i] < 0) continue;
    plane[kept] = plane[i];
    distance_m[kept++] = distance_m[i];
  }
  plane.resize(kept);
  distance_m.resize(kept);
  return {count, std::move(distance_m), std::move(plane)};
}

NormalSystem normal_system(std::span<const RegistrationTerm> terms, const Pose& T,
                           const RegistrationStage& stage, const PointSelection& selection) {
  NormalSystem system;
  for (const RegistrationTerm& term : terms) {
    sum_over_points(
        term, T, thinned(selection, *term.scan, stage.max_points), system,
        [&](const PointMover& mover, const PointMover::Hit& hit, std::size_t point, Sums& sums) {
          if (std::abs(hit.distance_m) > stage.gate_m) return;
          sums.add(mover.jacobian(hit, point), kernel_weight(stage, hit.distance_m),
                   hit.distance_m);
        });
  }
  mirror(system.H);
  return system;
}

NormalSystem plane_weighted_system(const RegistrationTerm& term, const Pose& T, double gate_m,
                                   std::span<const double> weight_of_plane,
                                   const PointSelection& selection) {
  NormalSystem system;
  sum_over_points(
      term, T, selection, system,
      [&](const PointMover& mover, const PointMover::Hit& hit, std::size_t point, Sums& sums) {
        if (std::abs(hit.distance_m) > gate_m) return;
        sums.add(mover.jacobian(hit, point), weight_of_plane[static_cast<std::size_t>(hit.plane)],
                 0.0);
      });
  mirror(system.H);
  return system;
}

}  // namespace cellmap
