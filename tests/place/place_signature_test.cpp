#include "cellmap/place/place_signature.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "cellmap/place/polar_image.hpp"
#include "place/seen_towns.hpp"

namespace cellmap {
namespace {

using test::seen;
using test::sensor_at;
using test::town;
using test::turned_cloud;

constexpr double kSignatureDeg = std::numbers::pi / 180;

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

}  // namespace
}  // namespace cellmap
