#include "cellmap/place/place_search.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <mutex>
#include <numbers>
#include <random>
#include <set>

#include "place/seen_towns.hpp"

namespace cellmap {
namespace {

using test::seen;
using test::sensor_at;
using test::town;

constexpr double kSearchDeg = std::numbers::pi / 180;

/// Described CELLs somewhere on a plane, searched in parts or as a whole.
class Places : public PlaceParts {
 public:
  void add(CellId id, const PointCloud& points, double x, double y) {
    add(id, describe_place(points), x, y);
  }
  void add(CellId id, const DescribedPlace& place, double x, double y) {
    graph_.nodes[id] = upright_pose(x, y, 0);
    described_.insert_or_assign(id, place);
  }
  const std::map<CellId, DescribedPlace>& described() const { return described_; }
  const PoseGraph& graph() const { return graph_; }
  std::size_t regions() const { return PlaceRegions(graph_).all().size(); }
  PartsSearcher searcher() const { return PartsSearcher({std::shared_ptr<void>(), this}); }

  std::vector<CellId> most_alike(const DescribedQuery& query, std::size_t count,
                                 int threads = 1) const {
    return ids_of(
        cellmap::most_alike(query.views(), PlaceRegions(graph_), searcher(), count, threads));
  }
  /// One part that holds everything.
  std::vector<CellId> most_alike_of_the_whole(const DescribedQuery& query,
                                              std::size_t count) const {
    Places whole;
    for (const auto& [id, place] : described_) whole.add(id, place, 0, 0);
    EXPECT_EQ(whole.regions(), 1u);
    return whole.most_alike(query, count);
  }

  std::shared_ptr<const PlacePart> part(const RegionKey& key) const override {
    auto part = std::make_shared<PlacePart>();
    const PlaceRegions regions(graph_);
    for (const CellId id : regions.find(key)->ids) part->put(id, described_.at(id));
    const std::lock_guard lock(mutex_);
    asked.push_back(key);
    return part;
  }
  bool is_at_hand(const RegionKey& key) const override { return at_hand.contains(key); }

  mutable std::vector<RegionKey> asked;
  std::set<RegionKey> at_hand;

 private:
  static std::vector<CellId> ids_of(const std::vector<AlikePlace>& places) {
    std::vector<CellId> ids;
    for (const AlikePlace& place : places) ids.push_back(place.id);
    return ids;
  }

  mutable std::mutex mutex_;
  PoseGraph graph_;
  std::map<CellId, DescribedPlace> described_;
};

/// Towns that differ a little from one of twenty each, scattered over some ten kilometres.
void add_towns(unsigned count, Places& places) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> xy(-2500, 2500);
  for (unsigned i = 0; i < count; ++i) {
    PointCloud points = town(1 + i % 20);
    points.append(every_nth(town(1000 + i), 5));
    places.add({i}, seen(points, sensor_at(0, 0, 0)), xy(rng), xy(rng));
  }
}

PointCloud without_what_is_ahead(const PointCloud& points) {
  PointCloud rest;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (points.x[i] < std::abs(points.y[i])) rest.push_back(points[i]);
  }
  return rest;
}

TEST(PlaceSearch, FindsPlaceAndPoseFromAnotherLaneAndHeading) {
  Places places;
  for (unsigned i = 1; i <= 19; ++i) {
    places.add({i}, seen(town(i), sensor_at(0, 0, 0)), 100.0 * i, 0);
  }
  const Pose T_town_sensor = sensor_at(2.6, 3.7, 200 * kSearchDeg);
  for (const unsigned place : {1u, 7u, 19u}) {
    const DescribedQuery query(seen(town(place), T_town_sensor));
    const auto alike = places.most_alike(query, 3);
    ASSERT_EQ(alike.size(), 3u);
    EXPECT_EQ(alike[0].value, place);
    const auto alignments = align(query, places.described().at({place}), 4);
    ASSERT_FALSE(alignments.empty());
    const Pose T_cell_query = sensor_at(0, 0, 0).inverse() * T_town_sensor;
    const Pose& found = alignments[0].T_cell_query;
    EXPECT_LT((found.translation() - T_cell_query.translation()).norm(), 1.6);
    EXPECT_LT(angle_between_rad(found, T_cell_query), 6.5 * kSearchDeg);
  }
}

/// Beyond kCompareAll CELLs most are compared with every second view alone.
TEST(PlaceSearch, InAManyTimesLargerMapTheSamePlacesAreFoundInPartsAsInOne) {
  Places places;
  add_towns(kCompareAll + 20, places);
  ASSERT_GT(places.regions(), 200u);
  for (const unsigned of : {3u, 11u}) {
    const DescribedQuery query(seen(town(1 + of), sensor_at(1.8, 0.3, 70 * kSearchDeg)));
    std::vector<std::pair<double, CellId>> one_by_one;
    for (const auto& [id, place] : places.described()) {
      one_by_one.push_back({-align(query, place, 1)[0].similarity, id});
    }
    std::sort(one_by_one.begin(), one_by_one.end());
    const auto alike = places.most_alike(query, 10);
    for (std::size_t k = 0; k < 10; ++k) EXPECT_EQ(alike[k], one_by_one[k].second) << k;
    // To the last of many, too, whatever the threads and the order of the parts.
    const auto whole = places.most_alike_of_the_whole(query, 1500);
    EXPECT_EQ(places.most_alike(query, 1500), whole);
    places.at_hand = {{3, 3}, {-4, 0}, {0, 7}};
    EXPECT_EQ(places.most_alike(query, 1500, 2), whole);
  }
  const DescribedQuery narrow(without_what_is_ahead(seen(town(7), sensor_at(1, 0, 1))));
  ASSERT_FALSE(narrow.views().sees_all());
  EXPECT_EQ(places.most_alike(narrow, 30), places.most_alike_of_the_whole(narrow, 30));
}

TEST(PlaceSearch, InASmallMapTheSamePlacesAreFoundInPartsAsInOne) {
  Places places;
  add_towns(150, places);
  ASSERT_LT(places.described().size(), kCompareAll);
  for (const unsigned of : {2u, 17u}) {
    const DescribedQuery query(seen(town(of), sensor_at(0.5, 1.1, 3)));
    EXPECT_EQ(places.most_alike(query, 40), places.most_alike_of_the_whole(query, 40));
    EXPECT_EQ(places.most_alike(query, 1000).size(), 150u);
  }
}

TEST(PlaceSearch, OfPlacesThatLookTheSameTheLowestNumbersAreTheBest) {
  Places places;
  const DescribedPlace same = describe_place(seen(town(1), sensor_at(0, 0, 0)));
  const DescribedPlace other = describe_place(seen(town(2), sensor_at(0, 0, 0)));
  for (unsigned i = 0; i < 60; ++i) {
    const unsigned id = (37 * i) % 60;
    places.add({id}, id % 3 == 0 ? other : same, 100.0 * i, 0);
  }
  const DescribedQuery query(seen(town(1), sensor_at(1, 0, 0)));
  const std::vector<CellId> lowest = {{1}, {2}, {4}, {5}, {7}};
  EXPECT_EQ(places.most_alike(query, 5), lowest);
  EXPECT_EQ(places.most_alike(query, 5, 2), lowest);
}

/// What is loaded is read before what has to be loaded takes its room.
TEST(PlaceSearch, PartsAtHandAreSearchedFirstAndEachOnce) {
  Places places;
  const DescribedPlace same = describe_place(seen(town(1), sensor_at(0, 0, 0)));
  for (unsigned i = 0; i < 5; ++i) places.add({i}, same, (i + 0.5) * kRegionSideM, 0);
  places.at_hand = {{4, 0}, {2, 0}};
  places.most_alike(DescribedQuery(seen(town(1), sensor_at(1, 0, 0))), 2);
  EXPECT_EQ(places.asked, (std::vector<RegionKey>{{2, 0}, {4, 0}, {0, 0}, {1, 0}, {3, 0}}));
}

}  // namespace
}  // namespace cellmap
