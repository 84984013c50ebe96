#include "cellmap/map/georeference.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

constexpr double kDeg = std::numbers::pi / 180;
constexpr double kA = 6378137.0, kF = 1 / 298.257223563, kE2 = kF * (2 - kF);  // WGS-84

/// Textbook geodetic to Earth-centred coordinates: an independent way to the same place.
Eigen::Vector3d earth_centred(double latitude_deg, double longitude_deg, double height_m) {
  const double phi = latitude_deg * kDeg, lambda = longitude_deg * kDeg;
  const double n = kA / std::sqrt(1 - kE2 * std::sin(phi) * std::sin(phi));
  return {(n + height_m) * std::cos(phi) * std::cos(lambda),
          (n + height_m) * std::cos(phi) * std::sin(lambda),
          (n * (1 - kE2) + height_m) * std::sin(phi)};
}

/// Columns: east, north and up in Earth-centred axes.
Eigen::Matrix3d enu_axes(double latitude_deg, double longitude_deg) {
  const double phi = latitude_deg * kDeg, lambda = longitude_deg * kDeg;
  Eigen::Matrix3d axes;
  axes.col(0) = Eigen::Vector3d(-std::sin(lambda), std::cos(lambda), 0);
  axes.col(2) = Eigen::Vector3d(std::cos(phi) * std::cos(lambda), std::cos(phi) * std::sin(lambda),
                                std::sin(phi));
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

Pose pose(double x, double y, double z, double yaw_rad, double pitch_rad) {
  Pose T = Pose::Identity();
  T.translation() = Eigen::Vector3d(x, y, z);
  T.linear() = (Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()) *
                Eigen::AngleAxisd(pitch_rad, Eigen::Vector3d::UnitY()))
                   .toRotationMatrix();
  return T;
}

std::vector<Georeference> places() {
  const Eigen::Matrix3d turned = pose(0, 0, 0, 1.1, 0.02).linear();
  return {{49.0114, 8.4204, 116.4, turned},
          {-33.9, 151.2, 30, Eigen::Matrix3d::Identity()},
          {0, 180, 0, turned},
          {89.9, -45, 2000, turned}};
}

TEST(Georeference, PutsAPoseWhereTheEllipsoidSays) {
  for (const Georeference& georeference : places()) {
    const Eigen::Vector3d origin =
        earth_centred(georeference.latitude_deg, georeference.longitude_deg, georeference.height_m);
    const Eigen::Matrix3d R_earth_map =
        enu_axes(georeference.latitude_deg, georeference.longitude_deg) * georeference.R_enu_map;
    for (const Pose& T :
         {pose(0, 0, 0, 0, 0), pose(120, -340, 8, 2, 0.1), pose(9e3, 7e3, 0, -3, 0)}) {
      const GeoPose geopose = to_geopose(georeference, T);
      const Eigen::Vector3d place =
          earth_centred(geopose.latitude_deg, geopose.longitude_deg, geopose.height_m);
      EXPECT_LT((place - (origin + R_earth_map * T.translation())).norm(), 1e-6);
      const Eigen::Matrix3d R_earth_body = enu_axes(geopose.latitude_deg, geopose.longitude_deg) *
                                           geopose.q_enu_body.toRotationMatrix();
      EXPECT_LT((R_earth_body - R_earth_map * T.linear()).norm(), 1e-9);
      EXPECT_GE(geopose.q_enu_body.w(), 0);
    }
  }
}

TEST(Georeference, ComesBackFromAGeoPose) {
  for (const Georeference& georeference : places()) {
    const Pose T = pose(1200, -340, 8, 2, 0.1);
    const Pose back = from_geopose(georeference, to_geopose(georeference, T));
    EXPECT_LT((back.matrix() - T.matrix()).norm(), 1e-7);
  }
}

TEST(Georeference, IsRefusedOutOfRange) {
  Georeference nowhere;
  nowhere.latitude_deg = 91;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { nowhere.validate(); }, "latitude");
  Georeference skewed;
  skewed.R_enu_map(0, 1) = 0.5;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { skewed.validate(); }, "rotation");
}

}  // namespace
}  // namespace cellmap
