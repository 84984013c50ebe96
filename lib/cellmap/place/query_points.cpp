#include "cellmap/place/query_points.hpp"

#include <cmath>

namespace cellmap {
namespace {

/// Some of the points, evenly taken: three quarters of them upright structure where there is
/// enough.
PointCloud mostly_upright(const PointCloud& upright, const PointCloud& ground, std::size_t count) {
  PointCloud some = thinned(upright, count / 2);
  some.append(thinned(ground, count > some.size() ? count - some.size() : 1));
  return some;
}

/// Upright surfaces of a query that knows its normals.
UprightSurfaces surfaces_of(const RelocalisationQuery& query, const Eigen::Vector3d& up) {
  UprightSurfaces surfaces;
  for (std::size_t i = 0; i < query.normals.size(); ++i) {
    if (std::abs(up.dot(query.normals[i].cast<double>())) >= 0.7) continue;
    surfaces.points.push_back(query.points[i]);
    surfaces.normals.push_back(query.normals[i]);
  }
  return surfaces;
}

}  // namespace

QueryPoints::QueryPoints(const RelocalisationQuery& query, const DescribedQuery& described,
                         const RelocaliseOptions& options)
    : scored(thinned(query.points, options.refine_points)),
      T_ground_query(described.ground().T_ground_sensor),
      is_narrow(described.is_narrow()) {
  const GroundFrame& ground = described.ground();
  constexpr double kUprightM = 0.5;
  PointCloud upright, level;
  const Eigen::Vector3d up = ground.T_ground_sensor.linear().row(2);
  const double height = ground.T_ground_sensor.translation().z();
  // No more than what the finest of the selections can use.
  const PointCloud some = thinned(query.points, 4 * options.refine_points);
  for (std::size_t i = 0; i < some.size(); ++i) {
    const Eigen::Vector3f p = some[i];
    (up.dot(p.cast<double>()) + height > kUprightM ? upright : level).push_back(p);
  }
  screen = mostly_upright(upright, level, options.screen_points);
  search = mostly_upright(upright, level, options.search_points);
  refine = mostly_upright(upright, level, options.refine_points / 2);
  surfaces = surfaces_of(query, up);
}

}  // namespace cellmap
