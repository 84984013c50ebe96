#include "cellmap/cell/plane_fit.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace cellmap {
namespace {

constexpr int kRefits = 2;

/// Smallest eigenvalue of a symmetric positive semi-definite matrix of trace 1: the smallest root
/// of p(x) = x^3 - x^2 + c1 x - determinant. p is concave up to 1/3, where the smallest root lies,
/// so Newton's method takes any start there to or below the root, and from below it rises without
/// overshooting. Started from the root of p without its cube, which is near where planes are flat.
double smallest_eigenvalue(double c1, double determinant) {
  constexpr int kMaxSteps = 60;
  const double discriminant = c1 * c1 - 4 * determinant;
  double x = 0;
  if (discriminant > 0) {
    x = 2 * determinant / (c1 + std::sqrt(discriminant));
    x -= (((x - 1) * x + c1) * x - determinant) / ((3 * x - 2) * x + c1);
    if (!(x > 0 && x <= 1.0 / 3)) x = 0;
  }
  for (int step = 0; step < kMaxSteps; ++step) {
    const double value = ((x - 1) * x + c1) * x - determinant;
    const double slope = (3 * x - 2) * x + c1;
    if (!(value < 0) || !(slope > 0)) break;
    const double next = x - value / slope;
    if (!(next > x)) break;
    x = next;
  }
  return x;
}

/// The direction that the symmetric singular matrix `A` maps to zero; zero where it is not unique.
Eigen::Vector3d null_direction(const Eigen::Matrix3d& A) {
  const Eigen::Vector3d candidates[3] = {A.col(0).cross(A.col(1)), A.col(1).cross(A.col(2)),
                                         A.col(2).cross(A.col(0))};
  Eigen::Vector3d longest = candidates[0];
  for (const Eigen::Vector3d& candidate : candidates) {
    if (candidate.squaredNorm() > longest.squaredNorm()) longest = candidate;
  }
  const double norm = std::sqrt(longest.squaredNorm());
  // A has trace 1, so this is relative: below it the two smaller eigenvalues are the same number.
  return norm > 1e-13 ? Eigen::Vector3d(longest / norm) : Eigen::Vector3d::Zero();
}

/// Points within `max_distance` of the plane to the front, in their old order among themselves.
std::size_t partition_by_distance(std::span<PatchPoint> points, const Eigen::Vector3d& normal,
                                  const Eigen::Vector3d& centroid, double max_distance) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double distance = normal.dot(position(points[i]) - centroid);
    if (std::abs(distance) <= max_distance) std::swap(points[kept++], points[i]);
  }
  return kept;
}

/// SplitMix64: a good bijective mixer, so patch numbers next to each other draw independently.
std::uint64_t next_random(std::uint64_t& state) {
  std::uint64_t z = (state += 0x9E3779B97F4A7C15ULL);
  z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
  z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
  return z ^ (z >> 31);
}

std::size_t draw_below(std::uint64_t& state, std::size_t count) {
  return static_cast<std::size_t>(((next_random(state) >> 32) * count) >> 32);
}

std::optional<FittedPlane> fit_plane(const simd::Moments& moments, const Eigen::Vector3d& origin) {
  if (moments.count < 3) return std::nullopt;
  const double inverse_count = 1.0 / moments.count;
  const Eigen::Vector3d mean =
      Eigen::Vector3d(moments.sum[0], moments.sum[1], moments.sum[2]) * inverse_count;
  const auto& [xx, xy, xz, yy, yz, zz] = moments.products;
  Eigen::Matrix3d C;
  C << xx, xy, xz, xy, yy, yz, xz, yz, zz;
  C = C * inverse_count - mean * mean.transpose();
  const double trace = C.trace();
  if (!(trace > 0)) return std::nullopt;

  const Eigen::Matrix3d A = C / trace;
  const double c1 = A(0, 0) * A(1, 1) - A(0, 1) * A(0, 1) + A(0, 0) * A(2, 2) - A(0, 2) * A(0, 2) +
                    A(1, 1) * A(2, 2) - A(1, 2) * A(1, 2);
  const double smallest = smallest_eigenvalue(c1, A.determinant());
  FittedPlane plane;
  plane.normal = null_direction(A - smallest * Eigen::Matrix3d::Identity());
  if (plane.normal.isZero(0)) return std::nullopt;
  // The other two have the sum 1 - smallest and the product c1 - smallest (1 - smallest).
  const double sum = 1 - smallest;
  const double product = c1 - smallest * sum;
  const double middle = (sum - std::sqrt(std::max(0.0, sum * sum - 4 * product))) / 2;
  plane.centroid = origin + mean;
  plane.variance_across_m2 = smallest * trace;
  plane.variance_within_m2 = middle * trace;
  plane.points = static_cast<std::size_t>(moments.count);
  return plane;
}

}  // namespace

void CentredPatch::assign(std::span<const PatchPoint> points) {
  count_ = points.size();
  origin_ = position(points.front());
  const std::size_t room = simd::padded(count_);
  if (x_.size() < room) {
    x_.resize(room);
    y_.resize(room);
    z_.resize(room);
  }
  squared_ranges_ = simd::centre(points.data(), count_, x_.data(), y_.data(), z_.data());
}

std::optional<FittedPlane> fit_plane(std::span<const PatchPoint> points) {
  if (points.empty()) return std::nullopt;
  CentredPatch patch;
  patch.assign(points);
  return fit_plane(simd::moments(patch.points()), patch.origin());
}

std::optional<FittedPlane> fit_plane_trimmed(const CentredPatch& patch,
                                             const CellBuildOptions& options) {
  const simd::Moments all = simd::moments(patch.points());
  std::optional<FittedPlane> plane = fit_plane(all, patch.origin());
  for (int refit = 0; refit < kRefits && plane; ++refit) {
    const double limit = options.trim_rms_factor * std::sqrt(plane->variance_across_m2);
    const Eigen::Vector3d& n = plane->normal;
    const simd::Moments off = simd::moments_off_plane(
        patch.points(), {n.x(), n.y(), n.z()}, n.dot(plane->centroid - patch.origin()), limit);
    const simd::Moments kept = all - off;
    if (off.count == 0 || kept.count < options.min_points) break;
    std::optional<FittedPlane> refitted = fit_plane(kept, patch.origin());
    if (!refitted) break;
    plane = refitted;
  }
  return plane;
}

std::optional<FittedPlane> fit_plane_ransac(std::span<PatchPoint> points,
                                            const CellBuildOptions& options, std::uint32_t patch) {
  if (points.size() < 3) return std::nullopt;
  std::uint64_t state = options.seed ^ (std::uint64_t{patch} << 20);
  std::size_t most = 0;
  Eigen::Vector3d best_normal = Eigen::Vector3d::Zero(), best_point = Eigen::Vector3d::Zero();
  for (std::uint32_t draw = 0; draw < options.ransac_draws; ++draw) {
    const Eigen::Vector3d a = position(points[draw_below(state, points.size())]);
    const Eigen::Vector3d b = position(points[draw_below(state, points.size())]);
    const Eigen::Vector3d c = position(points[draw_below(state, points.size())]);
    Eigen::Vector3d normal = (b - a).cross(c - a);
    const double norm = std::sqrt(normal.squaredNorm());
    if (!(norm > 0)) continue;
    normal /= norm;
    std::size_t agreeing = 0;
    for (const PatchPoint& p : points) {
      agreeing += std::abs(normal.dot(position(p) - a)) <= options.ransac_inlier_m;
    }
    if (agreeing > most) {
      most = agreeing;
      best_normal = normal;
      best_point = a;
    }
  }
  if (most < 3) return std::nullopt;
  const std::size_t kept =
      partition_by_distance(points, best_normal, best_point, options.ransac_inlier_m);
  return fit_plane(points.first(kept));
}

}  // namespace cellmap
