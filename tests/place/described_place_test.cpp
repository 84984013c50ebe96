#include "cellmap/place/described_place.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "cellmap/place/part_cache.hpp"
#include "place/seen_towns.hpp"

namespace cellmap {
namespace {

using test::seen;
using test::sensor_at;
using test::town;

/// A coefficient is off by up to half a step, so by step / sqrt(12) in the root mean square, and an
/// agreement with a view of unit norm by as much; five of it in the worst of thousands.
TEST(CompactSignature, AgreesWithOthersAsTheSignatureDoes) {
  for (unsigned i = 1; i <= 20; ++i) {
    const PlaceSignature place{Columns(town(i))};
    const PlaceSignature compact = CompactSignature(place).expanded();
    EXPECT_NEAR(compact.correlate(compact)[0], 1.0f, 1e-4f);
    const float greatest =
        std::max(place.cosine().cwiseAbs().maxCoeff(), place.sine().cwiseAbs().maxCoeff());
    const float bound = 5 * greatest / 127 / std::sqrt(12.0f);
    EXPECT_LT(bound, 0.005f);  // nothing beside what tells places apart
    for (const unsigned other : {i, i + 1, i + 2}) {
      const PlaceSignature view(Columns(town(other)), Eigen::Vector2d(1, 2));
      EXPECT_LT((compact.correlate(view) - place.correlate(view)).cwiseAbs().maxCoeff(), bound);
    }
    std::array<bool, Columns::kSectors> some{};
    std::fill_n(some.begin(), 25, true);
    EXPECT_LT((compact.visible_share(some) - place.visible_share(some)).cwiseAbs().maxCoeff(),
              0.003f);
  }
}

TEST(CompactSignature, ComparesWithManyViewsAsWhatItStandsFor) {
  const CompactSignature compact{PlaceSignature(Columns(town(3)))};
  std::vector<PlaceSignature> some;
  for (const unsigned i : {3u, 4u, 5u}) some.emplace_back(Columns(town(i)), Eigen::Vector2d(2, 0));
  const simd::TurnedViews views = PlaceSignature::side_by_side(some);
  for (const std::size_t harmonics : {5u, 13u}) {
    EXPECT_NEAR(compact.most_alike(views, harmonics),
                compact.expanded().most_alike(views, harmonics), 1e-5f);
  }
}

TEST(CompactSignature, OfNothingAgreesWithNothing) {
  const PlaceSignature nothing = CompactSignature(PlaceSignature(Columns(PointCloud()))).expanded();
  EXPECT_EQ(nothing.correlate(PlaceSignature(Columns(town(1)))).cwiseAbs().maxCoeff(), 0.0f);
}

TEST(DescribedPlace, ComesBackFromItsBytes) {
  const Pose leaning =
      sensor_at(0, 0, 0) * Pose(Eigen::AngleAxisd(0.1, Eigen::Vector3d(0.6, 0.8, 0)));
  const DescribedPlace place = describe_place(seen(town(4), leaning));
  const auto bytes = to_bytes(place);
  EXPECT_LE(bytes.size(), 1250u);
  const auto back = described_place_from_bytes(bytes);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->T_ground_cell.matrix(), place.T_ground_cell.matrix());
  EXPECT_EQ(back->signature.expanded().cosine(), place.signature.expanded().cosine());
  EXPECT_EQ(back->signature.expanded().sine(), place.signature.expanded().sine());
  EXPECT_EQ(back->signature.expanded().energy(), place.signature.expanded().energy());
}

TEST(DescribedPlace, BytesThatDescribeNothingAreDescribedAnew) {
  const auto bytes = to_bytes(describe_place(seen(town(4), sensor_at(0, 0, 0))));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_FALSE(described_place_from_bytes(std::span(bytes).first(size))) << size;
  }
  auto longer = bytes;
  longer.push_back({});
  EXPECT_FALSE(described_place_from_bytes(longer));
  auto another_form = bytes;
  another_form[0] = std::byte{2};
  EXPECT_FALSE(described_place_from_bytes(another_form));
  auto no_pose = bytes;
  std::fill(no_pose.end() - 96, no_pose.end(), std::byte{0xff});  // not numbers
  EXPECT_FALSE(described_place_from_bytes(no_pose));
}

TEST(DescribedPlace, IsSmall) { EXPECT_LE(sizeof(DescribedPlace), 1300u); }

std::shared_ptr<const PlacePart> part_of(std::uint32_t cells) {
  auto part = std::make_shared<PlacePart>();
  const DescribedPlace place = describe_place(PointCloud());
  for (std::uint32_t i = 1; i <= cells; ++i) part->put({i}, place);
  return part;
}

TEST(PlacePart, HoldsEachCellOnceByItsNumber) {
  PlacePart part;
  const DescribedPlace one = describe_place(seen(town(1), sensor_at(0, 0, 0)));
  DescribedPlace other = one;
  other.T_ground_cell.translation().z() += 1;
  for (const std::uint32_t id : {5u, 2u, 9u, 2u}) part.put({id}, one);
  part.put({5}, other);
  part.remove({9});
  part.remove({7});
  EXPECT_EQ(part.ids(), (std::vector<CellId>{{2}, {5}}));
  EXPECT_EQ(part.find({5})->T_ground_cell.translation().z(),
            one.T_ground_cell.translation().z() + 1);
  EXPECT_EQ(part.find({2})->T_ground_cell.matrix(), one.T_ground_cell.matrix());
  EXPECT_EQ(part.find({9}), nullptr);
}

TEST(PartCache, WhatWasUsedLongestAgoMakesRoom) {
  const auto part = part_of(10);
  PartCache cache(3 * part->bytes());
  const auto index = cache.new_index();
  for (const int x : {0, 1, 2}) cache.insert({index, {x, 0}}, part);
  EXPECT_EQ(cache.find({index, {0, 0}}), part);
  cache.insert({index, {3, 0}}, part);
  EXPECT_EQ(cache.find({index, {1, 0}}), nullptr);
  for (const int x : {0, 2, 3}) EXPECT_EQ(cache.find({index, {x, 0}}), part) << x;
  EXPECT_EQ(cache.bytes(), 3 * part->bytes());
}

TEST(PartCache, APartLargerThanTheBudgetIsStillKeptAlone) {
  const auto small = part_of(1), large = part_of(50);
  PartCache cache(10 * small->bytes());
  const auto index = cache.new_index();
  cache.insert({index, {0, 0}}, small);
  cache.insert({index, {1, 0}}, large);
  EXPECT_FALSE(cache.contains({index, {0, 0}}));
  EXPECT_TRUE(cache.contains({index, {1, 0}}));
  cache.insert({index, {1, 0}}, small);  // in its place
  EXPECT_EQ(cache.bytes(), small->bytes());
}

TEST(PartCache, AnIndexLeavesWithAllItsParts) {
  const auto part = part_of(1);
  PartCache cache(100 * part->bytes());
  const auto one = cache.new_index(), other = cache.new_index();
  ASSERT_NE(one, other);
  for (const int x : {-5, 0, 7}) {
    cache.insert({one, {x, x}}, part);
    cache.insert({other, {x, x}}, part);
  }
  cache.erase_index(one);
  EXPECT_EQ(cache.bytes(), 3 * part->bytes());
  for (const int x : {-5, 0, 7}) {
    EXPECT_FALSE(cache.contains({one, {x, x}}));
    EXPECT_TRUE(cache.contains({other, {x, x}}));
  }
}

}  // namespace
}  // namespace cellmap
