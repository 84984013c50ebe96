#include "cellmap/cell/plane_rules.hpp"

#include <cmath>

#include "cellmap/geometry/angle.hpp"

namespace cellmap {

void CellPart::append(const CellPart& other) {
  indices.insert(indices.end(), other.indices.begin(), other.indices.end());
  planes.insert(planes.end(), other.planes.begin(), other.planes.end());
  const CellStatistics& more = other.statistics;
  statistics.points += more.points;
  statistics.points_in_planes += more.points_in_planes;
  statistics.patches_hit += more.patches_hit;
  statistics.rejected_few_points += more.rejected_few_points;
  statistics.rejected_gap += more.rejected_gap;
  statistics.rejected_planarity += more.rejected_planarity;
  statistics.rejected_grazing += more.rejected_grazing;
}

PlaneRules::PlaneRules(const Lattice& lattice, const CellBuildOptions& options)
    : lattice_(lattice),
      options_(options),
      min_towards_(std::sin(options.min_grazing_angle_deg * kRadPerDeg)) {
  const double max_tangent = std::tan(options.max_normal_error_deg * kRadPerDeg);
  max_tangent2_ = max_tangent * max_tangent;
}

bool PlaneRules::has_enough_points(std::uint32_t points, CellPart& part) const {
  part.statistics.points += points;
  ++part.statistics.patches_hit;
  const bool enough = points >= options_.min_points;
  part.statistics.rejected_few_points += !enough;
  return enough;
}

void PlaneRules::judge(const PatchExtent& patch, const std::optional<FittedPlane>& fitted,
                       CellPart& part) const {
  if (!fitted || fitted->points < options_.min_points || !is_planar(*fitted)) {
    ++part.statistics.rejected_planarity;
    return;
  }
  const std::optional<Plane> plane = plane_on_ray(patch, *fitted);
  if (!plane) {
    ++part.statistics.rejected_grazing;
    return;
  }
  part.statistics.points_in_planes += patch.points;
  part.indices.push_back(patch.index);
  part.planes.push_back(*plane);
}

bool PlaneRules::is_planar(const FittedPlane& fitted) const {
  const double max_rms2 = options_.max_plane_rms_m * options_.max_plane_rms_m;
  const double leverage = static_cast<double>(fitted.points) * fitted.variance_within_m2;
  return fitted.variance_across_m2 <= max_tangent2_ * leverage &&
         (options_.max_plane_rms_m == 0 || fitted.variance_across_m2 <= max_rms2) &&
         fitted.variance_across_m2 <= options_.max_thickness_ratio * fitted.variance_within_m2;
}

std::optional<Plane> PlaneRules::plane_on_ray(const PatchExtent& patch,
                                              const FittedPlane& fitted) const {
  const Eigen::Vector3d direction = lattice_.direction(patch.index);
  Eigen::Vector3d normal = fitted.normal;
  if (normal.dot(direction) > 0) normal = -normal;
  const double towards = -normal.dot(direction);
  if (!(towards > min_towards_)) return std::nullopt;
  const double distance = -normal.dot(fitted.centroid) / towards;
  if (!(distance >= patch.min_range_m - options_.range_margin_m && distance > 0 &&
        distance <= patch.max_range_m + options_.range_margin_m)) {
    return std::nullopt;
  }
  const Eigen::Vector3f n = normal.cast<float>();
  return Plane{static_cast<float>(distance), n.x(), n.y(), n.z()};
}

}  // namespace cellmap
