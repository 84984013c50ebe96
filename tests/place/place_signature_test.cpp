#include "cellmap/place/place_signature.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "cellmap/place/polar_image.hpp"
#include "cellmap/place/signature_index.hpp"

namespace cellmap {
namespace {

constexpr double kSignatureDeg = std::numbers::pi / 180;

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

PointCloud turned_cloud(const PointCloud& points, double yaw_rad) {
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

/// Without what lies between the azimuths -30 and 90 deg.
PointCloud with_a_missing_part(const PointCloud& points) {
  PointCloud rest;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double azimuth = std::atan2(points.y[i], points.x[i]);
    if (azimuth < -30 * kSignatureDeg || azimuth > 90 * kSignatureDeg) rest.push_back(points[i]);
  }
  return rest;
}

TEST(Columns, KnowWhichSectorsWereSeen) {
  const Columns all(town(1)), some(with_a_missing_part(town(1)));
  EXPECT_TRUE(all.sees_all());
  EXPECT_FALSE(some.sees_all());
  for (std::size_t s = 0; s < Columns::kSectors; ++s) {
    const double middle_deg = -180 + 6 * (static_cast<double>(s) + 0.5);
    EXPECT_EQ(some.seen()[s], middle_deg < -30 || middle_deg > 90) << middle_deg;
  }
}

/// What was not seen neither counts for a place nor against it.
TEST(PlaceSignature, AMissingPartOfTheViewHardlyLowersTheAgreement) {
  const PlaceSignature place{Columns(town(1))}, other{Columns(town(2))};
  const Columns columns(with_a_missing_part(town(1)));
  const PlaceSignature view(columns);
  const auto agreement = [&](const PlaceSignature& with) {
    return (with.correlate(view).array() / with.visible_share(columns.seen()).array()).eval();
  };
  EXPECT_GT(agreement(place)[0], 0.85f);
  EXPECT_LT(agreement(other).maxCoeff(), 0.6f);
}

/// The scan over all CELLs against one signature after the other.
TEST(PlaceSignature, ComparingManyViewsAtOnceIsComparingEach) {
  const PlaceSignature place{Columns(town(1))};
  std::vector<PlaceSignature> views;
  for (const double x : {-2.0, 0.0, 2.0, 4.0}) {
    views.emplace_back(Columns(turned_cloud(town(1), 50 * kSignatureDeg)), Eigen::Vector2d(x, 1));
  }
  PlaceSignature::Correlation expected = PlaceSignature::Correlation::Zero();
  for (const PlaceSignature& view : views) expected = expected.cwiseMax(place.correlate(view));
  std::array<float, PlaceSignature::kSectors> best;
  place.correlate(PlaceSignature::side_by_side(views), PlaceSignature::kHarmonics + 1, best);
  for (std::size_t k = 0; k < best.size(); ++k) EXPECT_NEAR(best[k], expected[k], 1e-5f) << k;
}

TEST(PlaceSignature, TheMostAlikeTurnIsTheBestOfAllTurns) {
  const PlaceSignature stored{Columns(town(3))};
  std::vector<PlaceSignature> some;
  for (const unsigned i : {3u, 4u, 5u}) some.emplace_back(Columns(town(i)), Eigen::Vector2d(2, 0));
  const simd::TurnedViews views = PlaceSignature::side_by_side(some);
  std::array<float, PlaceSignature::kSectors> by_turn;
  for (const std::size_t harmonics : {5u, 13u}) {
    stored.correlate(views, harmonics, by_turn);
    EXPECT_EQ(stored.most_alike(views, harmonics),
              *std::max_element(by_turn.begin(), by_turn.end()));
  }
}

TEST(PlaceSignature, CorrelationPeaksAtTheTurnBetweenTwoViews) {
  const PlaceSignature place{Columns(town(1))};
  for (const int sectors : {0, 7, 45}) {
    const PlaceSignature view(Columns(turned_cloud(town(1), -sectors * 6 * kSignatureDeg)));
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
  const Pose T_town_sensor = sensor_at(2.6, 3.7, 200 * kSignatureDeg);
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
    EXPECT_LT(angle_between_rad(found, T_cell_query), 6.5 * kSignatureDeg);
  }
}

/// Beyond kCompareAll CELLs most are compared with every second view alone.
TEST(SignatureIndex, InAManyTimesLargerMapTheSamePlacesAreFound) {
  SignatureIndex index;
  const std::size_t copies = SignatureIndex::kCompareAll / 20 + 1;
  for (unsigned i = 0; i < 20 * copies; ++i) {
    // Towns that differ a little from one of twenty each.
    PointCloud points = town(1 + i % 20);
    points.append(every_nth(town(1000 + i), 5));
    index.add({i}, seen(points, sensor_at(0, 0, 0)));
  }
  ASSERT_GT(index.size(), SignatureIndex::kCompareAll);
  std::vector<std::size_t> slots;
  for (const auto& [id, slot] : index.slots()) slots.push_back(slot);
  for (const unsigned of : {3u, 11u}) {
    const DescribedQuery query(seen(town(1 + of), sensor_at(1.8, 0.3, 70 * kSignatureDeg)));
    std::vector<std::pair<double, std::uint64_t>> one_by_one;
    for (const auto& [id, slot] : index.slots()) {
      one_by_one.push_back({-index.align(query, id, 1)[0].similarity, id.value});
    }
    std::sort(one_by_one.begin(), one_by_one.end());
    const auto alike = index.most_alike(query, slots, 10, 1);
    for (std::size_t k = 0; k < 10; ++k) EXPECT_EQ(alike[k].value, one_by_one[k].second) << k;
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
