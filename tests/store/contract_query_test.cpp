#include <gmock/gmock.h>

#include <algorithm>
#include <limits>
#include <set>

#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

CellQuery within(const Eigen::Vector3d& near, double radius_m) {
  CellQuery query;
  query.near = near;
  query.radius_m = radius_m;
  return query;
}

CellQuery inside(const Eigen::AlignedBox3d& box) {
  CellQuery query;
  query.box = box;
  return query;
}

/// The slow twin: every CELL's position in a plain map, searched from end to end.
class Twin {
 public:
  std::map<std::uint32_t, Eigen::Vector3d> positions;

  std::vector<std::uint32_t> within(const Eigen::Vector3d& near, double radius_m) const {
    std::vector<std::pair<double, std::uint32_t>> found;
    for (const auto& [id, position] : positions) {
      const double squared = (position - near).squaredNorm();
      if (squared <= radius_m * radius_m) found.emplace_back(squared, id);
    }
    std::sort(found.begin(), found.end());
    std::vector<std::uint32_t> ids;
    for (const auto& [distance, id] : found) ids.push_back(id);
    return ids;
  }

  std::vector<std::uint32_t> inside(const Eigen::AlignedBox3d& box) const {
    std::vector<std::uint32_t> ids;
    for (const auto& [id, position] : positions) {
      if (box.contains(position)) ids.push_back(id);
    }
    return ids;
  }
};

/// Coordinates where a grid search can go wrong: on and around borders of the 64 m grid, on both
/// sides of zero, near and far.
class Coordinates {
 public:
  explicit Coordinates(unsigned seed) : random_(seed) {}

  double next() {
    std::uniform_int_distribution<int> kind(0, 5), column(-4, 4);
    std::uniform_real_distribution<double> anywhere(-300, 300);
    const double border = 64.0 * column(random_);
    switch (kind(random_)) {
      case 0:
        return border;
      case 1:
        return std::nextafter(border, -kInfinity);
      case 2:
        return std::nextafter(border, kInfinity);
      default:
        return anywhere(random_);
    }
  }
  Eigen::Vector3d position() { return {next(), next(), next() / 30}; }

 private:
  std::mt19937 random_;
};

Pose at(const Eigen::Vector3d& position) {
  return pose_at(position.x(), position.y(), position.z());
}

void expect_same_answers(const Store& store, const Twin& twin, Coordinates& coordinates) {
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d near = coordinates.position();
    const double radius_m = std::abs(coordinates.next()) + 0.5;
    EXPECT_EQ(ids_of(store.cells("town", within(near, radius_m)).cells),
              twin.within(near, radius_m));
    const std::size_t count = static_cast<std::size_t>(i);
    std::vector<std::uint32_t> nearest = twin.within(near, 1e9);
    nearest.resize(std::min(count, nearest.size()));
    EXPECT_EQ(ids_of(store.nearest("town", near, count)), nearest);
    Eigen::AlignedBox3d box(coordinates.position());
    box.extend(coordinates.position());
    EXPECT_EQ(ids_of(store.cells("town", inside(box)).cells), twin.inside(box));
  }
}

TEST_P(StoreContract, PlacesAreFoundAsByTryingEveryCellAlsoAfterMoves) {
  store_->create_map("town", {});
  store_->create_map("other", {});
  Coordinates coordinates(1);
  Twin twin;
  std::vector<NewCell> cells;
  for (std::uint32_t id = 0; id < 300; ++id) {
    twin.positions[id] = coordinates.position();
    cells.push_back(make_cell(id, at(twin.positions[id])));
  }
  store_->commit("town", adding(cells));
  store_->commit("other", adding(cells));  // must not show up
  expect_same_answers(*store_, twin, coordinates);

  std::map<CellId, Pose> moves;
  for (std::uint32_t id = 0; id < 300; id += 2) {
    twin.positions[id] = coordinates.position();
    moves.emplace(CellId{id}, at(twin.positions[id]));
  }
  store_->commit("town", moving(moves));
  expect_same_answers(*store_, twin, coordinates);
}

TEST_P(StoreContract, TheNearestAreFoundFromAnyDistance) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1, pose_at(0, 0)), make_cell(2, pose_at(9e6, -9e6)),
                                 make_cell(3, pose_at(1, 0, 5000))}));
  EXPECT_THAT(ids_of(store_->nearest("town", {-1e7, 1e7, 1e7}, 2)), ElementsAre(3, 1));
  EXPECT_THAT(ids_of(store_->nearest("town", {0, 0, 0}, 10)), ElementsAre(1, 3, 2));
  EXPECT_THAT(store_->nearest("town", {0, 0, 0}, 0), IsEmpty());
}

TEST_P(StoreContract, EqualDistancesComeByIdAndTheRimBelongsToTheCircle) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(4, pose_at(5, 0)), make_cell(2, pose_at(0, 5)),
                                 make_cell(3, pose_at(0, -5)), make_cell(1, pose_at(-5, 1e-6))}));
  EXPECT_THAT(ids_of(store_->cells("town", within({0, 0, 0}, 5)).cells), ElementsAre(2, 3, 4));
}

TEST_P(StoreContract, ConditionsAddUp) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1, pose_at(1, 0)), make_cell(2, pose_at(2, 0), "b"),
                                 make_cell(3, pose_at(3, 0))}));
  store_->commit("town", adding({make_cell(4, pose_at(4, 0)), make_cell(5, pose_at(50, 0))}));
  CellQuery query = within({0, 0, 0}, 10);
  EXPECT_THAT(ids_of(store_->cells("town", query).cells), ElementsAre(1, 2, 3, 4));
  query.session = "drive";
  EXPECT_THAT(ids_of(store_->cells("town", query).cells), ElementsAre(1, 3, 4));
  query.box = Eigen::AlignedBox3d(Eigen::Vector3d(2, -1, -1), Eigen::Vector3d(60, 1, 1));
  EXPECT_THAT(ids_of(store_->cells("town", query).cells), ElementsAre(3, 4));
  query.since = 1;
  EXPECT_THAT(ids_of(store_->cells("town", query).cells), ElementsAre(4));
  query.near.reset();
  query.radius_m = 0;
  EXPECT_THAT(ids_of(store_->cells("town", query).cells), ElementsAre(4, 5));
}

TEST_P(StoreContract, SinceMeansAddedOrMovedAfterThatRevision) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(1), make_cell(2)}));
  store_->commit("town", adding({make_cell(3)}));
  store_->commit("town", moving({{{1}, pose_at(1, 1)}}));
  CellQuery query;
  for (const auto& [since, expected] : std::map<Revision, std::vector<std::uint32_t>>{
           {0, {1, 2, 3}}, {1, {1, 3}}, {2, {1}}, {3, {}}, {99, {}}}) {
    query.since = since;
    EXPECT_EQ(ids_of(store_->cells("town", query).cells), expected) << since;
  }
}

/// All pages of a query put together.
std::vector<std::uint32_t> paged(const Store& store, CellQuery query, std::size_t limit) {
  std::vector<std::uint32_t> ids;
  query.limit = limit;
  do {
    const CellPage page = store.cells("town", query);
    EXPECT_LE(page.cells.size(), limit);
    EXPECT_EQ(page.cells.size() < limit, page.cells.size() < limit && page.next_cursor.empty());
    const auto more = ids_of(page.cells);
    ids.insert(ids.end(), more.begin(), more.end());
    query.cursor = page.next_cursor;
  } while (!query.cursor.empty());
  return ids;
}

TEST_P(StoreContract, PagesPutTogetherAreTheWholeAnswer) {
  store_->create_map("town", {});
  Coordinates coordinates(2);
  std::vector<NewCell> cells;
  for (std::uint32_t id = 0; id < 50; ++id) {
    cells.push_back(make_cell(3 * id, at(coordinates.position()), id % 3 ? "drive" : "b"));
  }
  store_->commit("town", adding(cells));
  CellQuery by_session;
  by_session.session = "b";
  const Eigen::AlignedBox3d box(Eigen::Vector3d(-200, -200, -99), Eigen::Vector3d(300, 300, 99));
  for (const CellQuery& query : {CellQuery(), by_session, inside(box), within({0, 0, 0}, 250)}) {
    const std::vector<std::uint32_t> whole = ids_of(store_->cells("town", query).cells);
    EXPECT_GT(whole.size(), 5u);
    for (const std::size_t limit :
         {std::size_t{1}, std::size_t{7}, whole.size(), whole.size() + 1}) {
      EXPECT_EQ(paged(*store_, query, limit), whole) << limit;
    }
  }
}

TEST_P(StoreContract, WritesBetweenPagesNeitherRepeatNorSkipACell) {
  store_->create_map("town", {});
  store_->commit("town", adding({make_cell(10), make_cell(20), make_cell(30), make_cell(40)}));
  CellQuery query;
  query.limit = 2;
  const CellPage first = store_->cells("town", query);
  EXPECT_THAT(ids_of(first.cells), ElementsAre(10, 20));
  store_->commit("town", adding({make_cell(5), make_cell(15), make_cell(35)}));
  query.cursor = first.next_cursor;
  query.limit = 10;
  const CellPage second = store_->cells("town", query);
  EXPECT_THAT(ids_of(second.cells), ElementsAre(30, 35, 40));
  EXPECT_EQ(first.revision, 1u);
  EXPECT_EQ(second.revision, 2u);
}

TEST_P(StoreContract, ACursorFitsItsOwnQueryOnly) {
  store_->create_map("town", {});
  store_->create_map("other", {});
  store_->commit("town", adding({make_cell(1), make_cell(2), make_cell(3)}));
  CellQuery query;
  query.limit = 1;
  const std::string cursor = store_->cells("town", query).next_cursor;
  ASSERT_FALSE(cursor.empty());
  std::string altered = cursor;
  altered.back() = 'x';
  for (const std::string& bad :
       {altered, cursor + "0", cursor.substr(1), std::string("'"), std::string(10'000, 'a')}) {
    query.cursor = bad;
    expect_error(
        ErrorCode::kInvalidArgument, [&] { store_->cells("town", query); }, "cursor");
  }
  query.cursor = cursor;
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->cells("other", query); }, "cursor");
  query.session = "drive";
  expect_error(
      ErrorCode::kInvalidArgument, [&] { store_->cells("town", query); }, "cursor");
}

TEST_P(StoreContract, MalformedQueriesAreRefused) {
  store_->create_map("town", {});
  const auto refused = [&](const CellQuery& query, const std::string& part) {
    expect_error(
        ErrorCode::kInvalidArgument, [&] { store_->cells("town", query); }, part);
  };
  CellQuery query;
  for (const std::size_t limit : {std::size_t{0}, std::size_t{10'001}}) {
    query.limit = limit;
    refused(query, "limit");
  }
  for (const double radius : {0.0, -1.0, std::nan(""), kInfinity}) {
    refused(within({0, 0, 0}, radius), "radius");
  }
  query = {};
  query.radius_m = 5;
  refused(query, "radius");
  refused(within({std::nan(""), 0, 0}, 5), "position");
  refused(within({0, 2e7, 0}, 5), "position");
  refused(inside(Eigen::AlignedBox3d(Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 1))), "box");
  refused(inside(Eigen::AlignedBox3d(Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(kInfinity, 1, 1))),
          "box");
  query = {};
  query.session = "a'b";
  refused(query, "session");
  expect_error(
      ErrorCode::kInvalidArgument,
      [&] {
        store_->nearest("town", {0, 0, std::nan("")}, 1);
      },
      "position");
  expect_error(
      ErrorCode::kInvalidArgument,
      [&] {
        store_->nearest("town", {0, 0, 0}, 10'001);
      },
      "count");
}

}  // namespace
}  // namespace cellmap::test
