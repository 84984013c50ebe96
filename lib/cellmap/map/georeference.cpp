#include "cellmap/map/georeference.hpp"

#include <GeographicLib/LocalCartesian.hpp>
#include <vector>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

using RowMajor3d = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

GeographicLib::LocalCartesian tangent_plane(const Georeference& g) {
  return {g.latitude_deg, g.longitude_deg, g.height_m};
}

/// GeographicLib's matrix turns vectors in the axes of a place into those of the origin.
Eigen::Matrix3d R_origin_place(const std::vector<double>& values) {
  return Eigen::Map<const RowMajor3d>(values.data());
}

}  // namespace

void Georeference::validate() const {
  const auto within = [](double value, double least, double most) {
    return value >= least && value <= most;  // false for NaN
  };
  if (!within(latitude_deg, -90, 90) || !within(longitude_deg, -180, 180) ||
      !within(height_m, -10'000, 100'000)) {
    throw Error(ErrorCode::kInvalidArgument,
                "a georeference needs a latitude of -90 to 90 and a longitude of -180 to 180 "
                "degrees, and a height of -10,000 to 100,000 m");
  }
  Pose T = Pose::Identity();
  T.linear() = R_enu_map;
  if (!is_rigid(T)) {
    throw Error(ErrorCode::kInvalidArgument, "the georeference's R_enu_map is no rotation");
  }
}

GeoPose to_geopose(const Georeference& georeference, const Pose& T_map_body) {
  const Eigen::Vector3d enu = georeference.R_enu_map * T_map_body.translation();
  GeoPose geopose;
  std::vector<double> matrix(9);
  tangent_plane(georeference)
      .Reverse(enu.x(), enu.y(), enu.z(), geopose.latitude_deg, geopose.longitude_deg,
               geopose.height_m, matrix);
  const Eigen::Matrix3d R =
      R_origin_place(matrix).transpose() * georeference.R_enu_map * T_map_body.linear();
  geopose.q_enu_body = Eigen::Quaterniond(R).normalized();
  if (geopose.q_enu_body.w() < 0) geopose.q_enu_body.coeffs() *= -1;
  return geopose;
}

Pose from_geopose(const Georeference& georeference, const GeoPose& geopose) {
  Eigen::Vector3d enu;
  std::vector<double> matrix(9);
  tangent_plane(georeference)
      .Forward(geopose.latitude_deg, geopose.longitude_deg, geopose.height_m, enu.x(), enu.y(),
               enu.z(), matrix);
  const Eigen::Matrix3d R_map_enu = georeference.R_enu_map.transpose();
  Pose T_map_body = Pose::Identity();
  T_map_body.translation() = R_map_enu * enu;
  T_map_body.linear() =
      R_map_enu * R_origin_place(matrix) * geopose.q_enu_body.normalized().toRotationMatrix();
  return T_map_body;
}

}  // namespace cellmap
