#include "cellmap/place/place_signature.hpp"

#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "cellmap/place/polar_image.hpp"
#include "cellmap/place/signature_index.hpp"

namespace cellmap {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

/// Upright things at random places on flat ground; z above the ground.
PointCloud town(unsigned seed) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<float> xy(-70, 70), height(1, 9), extent(-3, 3);
  PointCloud points;
  for (int thing = 0; thing < 60; ++thing) {
    const float x = xy(rng), y = xy(rng), top = height(rng);
    for (int i = 0; i < 60; ++i) {
      points.push_back({x + extent(rng), y + extent(rng), top * static_cast<float>(i % 10) / 10});
    }
  }
  for (int i = 0; i < 4000; ++i) points.push_back({xy(rng), xy(rng), 0});
  return points;
}

PointCloud turned(const PointCloud& points, double yaw_rad) {
  return transformed(points, upright_pose(0, 0, yaw_rad));
}

/// As a sensor 1.7 m above the ground would see it.
PointCloud seen(const PointCloud& points, const Pose& T_ground_sensor) {
  return transformed(points, T_ground_sensor.inverse());
}

Pose sensor_at(double x, double y, double yaw_rad) {
  Pose T = upright_pose(x, y, yaw_rad);
  T.translation().z() = 1.7;
  return T;
}

TEST(Columns, KeepWhatStandsWithinReachAndTheTopOfEach) {
  PointCloud points;
  for (const float z : {0.0f, 2.5f, 1.0f, 0.5f}) points.push_back({10.25f, -3.5f, z});
  points.push_back({500, 0, 0});
  const Columns columns(points);
  ASSERT_EQ(columns.all().size(), 1u);
  EXPECT_FLOAT_EQ(columns.all()[0].x, 10.25f);
  EXPECT_FLOAT_EQ(columns.all()[0].top_m, 2.5f);
  EXPECT_FLOAT_EQ(columns.all()[0].upright, 3.0f);
}

TEST(PlaceSignature, KeysOfOnePlaceAgreeAtAnyHeadingAndOfOthersDoNot) {
  const PlaceSignature::Key key = PlaceSignature(Columns(town(1))).key();
  for (const double yaw_deg : {6.0, 45.0, 133.0, 270.0}) {
    const Columns again(turned(town(1), yaw_deg * kDeg));
    EXPECT_GT(key.dot(PlaceSignature(again).key()), 0.95f) << yaw_deg;
  }
  for (const unsigned other : {2u, 3u, 4u}) {
    EXPECT_LT(key.dot(PlaceSignature(Columns(town(other))).key()), 0.9f);
  }
}

TEST(PlaceSignature, CorrelationPeaksAtTheTurnBetweenTwoViews) {
  const PlaceSignature place{Columns(town(1))};
  for (const int sectors : {0, 7, 45}) {
    const PlaceSignature view(Columns(turned(town(1), -sectors * 6 * kDeg)));
    const PlaceSignature::Correlation agreement = place.correlate(view);
    Eigen::Index peak = 0;
    EXPECT_GT(agreement.maxCoeff(&peak), 0.9f);
    EXPECT_EQ(peak, sectors);
  }
}

TEST(PlaceSignature, CorrelationIsBoundedAndOneOnlyForItself) {
  const PlaceSignature a{Columns(town(1))}, b{Columns(town(2))};
  EXPECT_NEAR(a.correlate(a)[0], 1.0f, 1e-4f);
  EXPECT_LE(a.correlate(b).cwiseAbs().maxCoeff(), 1.0f);
}

TEST(SignatureIndex, FindsPlaceAndPoseFromAnotherLaneAndHeading) {
  SignatureIndex index;
  for (unsigned i = 1; i <= 20; ++i) index.add({i}, seen(town(i), sensor_at(0, 0, 0)));
  index.remove({20});
  ASSERT_EQ(index.size(), 19u);
  std::vector<std::size_t> slots;
  for (const auto& [id, slot] : index.slots()) slots.push_back(slot);
  const Pose T_town_sensor = sensor_at(2.6, 3.7, 200 * kDeg);
  for (const unsigned place : {1u, 7u, 19u}) {
    const DescribedQuery query(seen(town(place), T_town_sensor));
    const auto alike = index.most_alike(query, slots, 3, 1);
    ASSERT_EQ(alike.size(), 3u);
    EXPECT_EQ(alike[0].value, place);
    const auto alignments = index.align(query, {place}, 4);
    ASSERT_FALSE(alignments.empty());
    const Pose T_cell_query = sensor_at(0, 0, 0).inverse() * T_town_sensor;
    const Pose& found = alignments[0].T_cell_query;
    EXPECT_LT((found.translation() - T_cell_query.translation()).norm(), 1.6);
    EXPECT_LT(angle_between_rad(found, T_cell_query), 6.5 * kDeg);
  }
}

TEST(SignatureIndex, DoesNotDependOnTheThreadCount) {
  SignatureIndex index;
  for (unsigned i = 1; i <= 12; ++i) index.add({i}, seen(town(i), sensor_at(0, 0, 0)));
  std::vector<std::size_t> slots;
  for (const auto& [id, slot] : index.slots()) slots.push_back(slot);
  const DescribedQuery query(seen(town(5), sensor_at(1, 1, 1)));
  EXPECT_EQ(index.most_alike(query, slots, 12, 1), index.most_alike(query, slots, 12, 2));
}

}  // namespace
}  // namespace cellmap
