#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "cellmap/scan/scan.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

PointCloud cloud_of(std::initializer_list<Eigen::Vector3f> points) {
  PointCloud cloud;
  for (const Eigen::Vector3f& p : points) cloud.push_back(p);
  return cloud;
}

TEST(FilterScan, PointsThatAreNotFiniteOrOutOfRangeAreDroppedAndCounted) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  const Scan scan = filter_scan(
      cloud_of({{3, 0, 0}, {nan, 1, 1}, {0, inf, 0}, {1, 1, 1}, {0, 0, 0}, {0, 121, 0}, {0, 0, 5}}),
      7, {});
  EXPECT_EQ(scan.stamp, 7);
  EXPECT_EQ(scan.dropped_non_finite, 2U);
  EXPECT_EQ(scan.dropped_range, 3U);
  ASSERT_EQ(scan.points.size(), 2U);
  EXPECT_EQ(scan.points[0], Eigen::Vector3f(3, 0, 0));
  EXPECT_EQ(scan.points[1], Eigen::Vector3f(0, 0, 5));
}

TEST(FilterScan, TheLimitsThemselvesAreInRange) {
  const Scan scan = filter_scan(cloud_of({{2, 0, 0}, {0, 120, 0}}), 0, {});
  EXPECT_EQ(scan.points.size(), 2U);
}

TEST(FilterScan, VerticalCorrectionRaisesTheElevationAndKeepsRangeAndAzimuth) {
  const PointCloud points = cloud_of({{10, 5, -2}, {-30, 4, 6}, {0, -8, 0}});
  const Scan scan = filter_scan(points, 0, {.vertical_angle_correction_deg = 0.205});
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d before = points[i].cast<double>(), after = scan.points[i].cast<double>();
    const auto elevation = [](const Eigen::Vector3d& p) {
      return std::atan2(p.z(), std::hypot(p.x(), p.y())) * 180 / std::numbers::pi;
    };
    EXPECT_NEAR(elevation(after) - elevation(before), 0.205, 1e-4);
    EXPECT_NEAR(after.norm(), before.norm(), 1e-5);
    EXPECT_NEAR(std::atan2(after.y(), after.x()), std::atan2(before.y(), before.x()), 1e-6);
  }
}

TEST(FilterScan, OptionsOutOfTheirRangesAreRefusedByName) {
  const auto filter = [](const ScanFilterOptions& options) { filter_scan({}, 0, options); };
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { filter({.min_range_m = 5, .max_range_m = 5}); },
      "max_range_m");
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { filter({.vertical_angle_correction_deg = NAN}); },
      "vertical_angle_correction_deg");
}

}  // namespace
}  // namespace cellmap
