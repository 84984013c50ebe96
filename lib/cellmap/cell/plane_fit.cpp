#include "cellmap/cell/plane_fit.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <numeric>
#include <utility>

#include "cellmap/simd/plane_batch.hpp"

namespace cellmap {
namespace {

constexpr int kRefits = 2;

/// Points within `max_distance` of the plane to the front, in their old order among themselves.
std::size_t partition_by_distance(PatchPoints& points, const Eigen::Vector3d& normal,
                                  const Eigen::Vector3d& centroid, double max_distance) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double distance = normal.dot(points[i] - centroid);
    if (std::abs(distance) <= max_distance) points.swap_points(kept++, i);
  }
  return kept;
}

std::optional<FittedPlane> plane_of(const simd::PlaneBatch& batch, std::size_t k,
                                    const Eigen::Vector3d& origin) {
  FittedPlane plane;
  plane.normal = {batch.normal[0][k], batch.normal[1][k], batch.normal[2][k]};
  if (plane.normal.isZero(0)) return std::nullopt;
  plane.centroid = origin + Eigen::Vector3d(batch.mean[0][k], batch.mean[1][k], batch.mean[2][k]);
  plane.variance_across_m2 = batch.variance_across[k];
  plane.variance_within_m2 = batch.variance_within[k];
  plane.points = static_cast<std::size_t>(batch.count[k]);
  return plane;
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

}  // namespace

void fit_planes(std::span<const MomentsAbout> moments, FittedPlanes planes) {
  simd::PlaneBatch batch;
  for (std::size_t begin = 0; begin < moments.size(); begin += batch.kSize) {
    batch.used = std::min(batch.kSize, moments.size() - begin);
    for (std::size_t k = 0; k < batch.used; ++k) batch.set(k, moments[begin + k].moments);
    simd::fit_planes(batch);
    for (std::size_t k = 0; k < batch.used; ++k) {
      planes[begin + k] = plane_of(batch, k, moments[begin + k].origin);
    }
  }
}

simd::Moments moments_off_plane(const PatchPoints& points, const FittedPlane& plane,
                                double rms_factor) {
  const Eigen::Vector3d& n = plane.normal;
  return simd::moments_off_plane(points.view(), {n.x(), n.y(), n.z()},
                                 n.dot(plane.centroid - points.origin()),
                                 rms_factor * std::sqrt(plane.variance_across_m2));
}

std::optional<FittedPlane> fit_plane(const PatchPoints& points) {
  const MomentsAbout moments{points.origin(), simd::moments(points.view())};
  std::optional<FittedPlane> plane;
  fit_planes({&moments, 1}, {&plane, 1});
  return plane;
}

void fit_planes_trimmed(std::span<const PatchPoints> patches, std::span<const MomentsAbout> moments,
                        const CellBuildOptions& options, FittedPlanes planes) {
  assert(patches.size() <= kPatchesAFit && moments.size() == patches.size());
  std::array<MomentsAbout, kPatchesAFit> kept;
  std::array<std::size_t, kPatchesAFit> refitted;  // whose moments `kept` holds
  std::array<std::optional<FittedPlane>, kPatchesAFit> next;
  std::iota(refitted.begin(), refitted.end(), std::size_t{0});
  fit_planes(moments, planes);
  std::size_t left = patches.size();
  for (int refit = 0; refit < kRefits; ++refit) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < left; ++i) {
      const std::size_t k = refitted[i];
      if (!planes[k]) continue;
      const simd::Moments off = moments_off_plane(patches[k], *planes[k], options.trim_rms_factor);
      kept[count] = {moments[k].origin, moments[k].moments - off};
      if (off.count == 0 || kept[count].moments.count < options.min_points) continue;
      refitted[count++] = k;
    }
    left = count;
    fit_planes(std::span(kept).first(count), next);
    for (std::size_t i = 0; i < count; ++i) {
      if (next[i]) planes[refitted[i]] = next[i];
    }
  }
}

std::optional<FittedPlane> fit_plane_ransac(PatchPoints& points, const CellBuildOptions& options,
                                            std::uint32_t patch) {
  if (points.size() < 3) return std::nullopt;
  std::uint64_t state = options.seed ^ (std::uint64_t{patch} << 20);
  std::size_t most = 0;
  Eigen::Vector3d best_normal = Eigen::Vector3d::Zero(), best_point = Eigen::Vector3d::Zero();
  for (std::uint32_t draw = 0; draw < options.ransac_draws; ++draw) {
    const Eigen::Vector3d a = points[draw_below(state, points.size())];
    const Eigen::Vector3d b = points[draw_below(state, points.size())];
    const Eigen::Vector3d c = points[draw_below(state, points.size())];
    Eigen::Vector3d normal = (b - a).cross(c - a);
    const double norm = std::sqrt(normal.squaredNorm());
    if (!(norm > 0)) continue;
    normal /= norm;
    std::size_t agreeing = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      agreeing += std::abs(normal.dot(points[i] - a)) <= options.ransac_inlier_m;
    }
    if (agreeing > most) {
      most = agreeing;
      best_normal = normal;
      best_point = a;
    }
  }
  if (most < 3) return std::nullopt;
  points.keep(partition_by_distance(points, best_normal, best_point, options.ransac_inlier_m));
  return fit_plane(points);
}

}  // namespace cellmap
