#pragma once

#include <Eigen/Geometry>

#include "cellmap/geometry/pose.hpp"

namespace cellmap {

/// Where the map frame lies on Earth.
struct Georeference {
  double latitude_deg = 0;   ///< of the map frame's origin, WGS-84; -90 to 90
  double longitude_deg = 0;  ///< -180 to 180
  double height_m = 0;       ///< above the ellipsoid; -10,000 to 100,000
  /// From the map frame to east, north and up at the origin.
  Eigen::Matrix3d R_enu_map = Eigen::Matrix3d::Identity();

  /// Throws Error{kInvalidArgument} out of range, or where R_enu_map is no rotation.
  void validate() const;
};

/// OGC GeoPose 1.0, Basic Quaternion: a position, and an orientation in the axes east, north and up
/// of that very position (which are not those of the map's origin: 10 km away they differ by 0.1
/// deg).
struct GeoPose {
  double latitude_deg = 0, longitude_deg = 0, height_m = 0;        ///< WGS-84, above the ellipsoid
  Eigen::Quaterniond q_enu_body = Eigen::Quaterniond::Identity();  ///< unit, w >= 0
};

/// Exact on the ellipsoid (GeographicLib), not a flat Earth.
GeoPose to_geopose(const Georeference& georeference, const Pose& T_map_body);
/// Its inverse, to within 1e-8 m and 1e-12 rad near the map.
Pose from_geopose(const Georeference& georeference, const GeoPose& geopose);

}  // namespace cellmap
