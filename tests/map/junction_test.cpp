#include "cellmap/map/junction.hpp"

#include <gtest/gtest.h>

#include <set>

#include "cellmap/place/polar_image.hpp"
#include "cellmap/pose_graph/frames.hpp"
#include "cellmap/scan/part_of_drive.hpp"
#include "support/town_drive.hpp"

namespace cellmap {
namespace {

using test::BuiltMap;
using test::TownDrive;

void drive_into(BuiltMap& map, std::unique_ptr<ScanSource> source, const std::string& session,
                const MapperOptions& options = test::quick_mapper_options()) {
  Mapper mapper(options, session, map.lattice, map.graph, map.access());
  build_map(*source, mapper, [&](CellUpdate&& update) { map.add(std::move(update)); });
}

/// Not once around the block: no session meets itself.
const TownDrive kDrive{.laps = 0.95, .drift_deg_per_m = 0.01, .stretch = 1.0};
constexpr std::size_t kFirstEnd = 56, kSecondBegin = 36;

std::unique_ptr<ScanSource> first_session() { return part_of_drive(kDrive.open(), 0, kFirstEnd); }

/// Begins before the first one ended, on another day, a metre beside its line.
TownDrive other_day() {
  TownDrive drive = kDrive;
  drive.lateral_offset_m = 1.0;
  drive.traffic_seed = 2;
  return drive;
}
std::unique_ptr<ScanSource> second_session() {
  return part_of_drive(other_day().open(), kSecondBegin, 0);
}

std::unique_ptr<ScanSource> session_elsewhere() {
  TownDrive drive = kDrive;
  drive.radius_m = 60;
  drive.laps = 0.2;
  drive.seed = 9;
  return drive.open();
}

class TwoSessions : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    map_ = std::make_unique<BuiltMap>();
    drive_into(*map_, first_session(), "first");
    first_cells_ = map_->updates.size();
    drive_into(*map_, second_session(), "second");
  }
  static void TearDownTestSuite() { map_.reset(); }

  static std::unique_ptr<BuiltMap> map_;
  static std::size_t first_cells_;
};
std::unique_ptr<BuiltMap> TwoSessions::map_;
std::size_t TwoSessions::first_cells_ = 0;

TEST_F(TwoSessions, TheSecondStartsInItsOwnFrame) {
  const CellUpdate& start = map_->updates.at(first_cells_);
  EXPECT_EQ(start.poses.size(), 1u);
  EXPECT_EQ(start.poses.at(start.id).matrix(), start.cell->T_odom_cell.matrix());
  EXPECT_TRUE(start.constraints.empty());
}

TEST_F(TwoSessions, BecomeOneMapInTheFrameOfTheFirst) {
  EXPECT_EQ(Frames(map_->graph).count(), 1u);
  const std::vector<Pose> truth = kDrive.truth();
  for (std::size_t i = 0; i < map_->updates.size(); ++i) {
    const CellUpdate& update = map_->updates[i];
    const bool second = i >= first_cells_;
    const Pose T_true = truth.at(update.cell->first_scan + (second ? kSecondBegin : 0)) *
                        Eigen::Translation3d(0, second ? other_day().lateral_offset_m : 0, 0);
    const Pose T_found = truth.front() * map_->graph.nodes.at(update.id);
    EXPECT_LT((T_found.translation() - T_true.translation()).norm(), 0.35)
        << update.cell->session << ' ' << update.cell->sequence;
  }
}

TEST_F(TwoSessions, AreJoinedByClosuresOfSeveralCellsInOneUpdate) {
  for (std::size_t i = first_cells_; i < map_->updates.size(); ++i) {
    std::set<CellId> closed;
    for (const Constraint& c : map_->updates[i].constraints) {
      const bool across = (c.from.value <= first_cells_) != (c.to.value <= first_cells_);
      if (across) closed.insert(std::max(c.from, c.to));
    }
    if (closed.empty()) continue;
    EXPECT_GE(closed.size(), 1 + JunctionOptions{}.confirmations);
    return;
  }
  FAIL() << "no closure ties the sessions";
}

TEST(Junction, ASessionElsewhereStaysAnIslandInItsOwnFrame) {
  BuiltMap map;
  drive_into(map, first_session(), "first");
  const std::size_t first_cells = map.updates.size();
  drive_into(map, session_elsewhere(), "elsewhere");
  ASSERT_GT(map.updates.size(), first_cells + 3);
  const Frames islands(map.graph);
  EXPECT_EQ(islands.count(), 2u);
  const CellUpdate& start = map.updates.at(first_cells);
  EXPECT_EQ(islands.of(map.updates.back().id), start.id);
  EXPECT_EQ(map.graph.nodes.at(start.id).matrix(), start.cell->T_odom_cell.matrix());
}

TEST(Junction, IsNotLookedForWhereItIsSwitchedOff) {
  BuiltMap map;
  MapperOptions options = test::quick_mapper_options();
  options.junctions = false;
  drive_into(map, first_session(), "first", options);
  drive_into(map, second_session(), "second", options);
  EXPECT_EQ(Frames(map.graph).count(), 2u);
}

TEST(Junction, BringingTogetherMovesTheYoungerIslandOnly) {
  PoseGraph graph;
  for (const std::uint32_t id : {1u, 2u, 5u, 6u}) {
    graph.nodes[{id}] = upright_pose(id, 0, 0.1 * id);
  }
  for (const auto& [from, to] : {std::pair(1u, 2u), std::pair(5u, 6u)}) {
    Constraint constraint;
    constraint.from = {from};
    constraint.to = {to};
    graph.constraints.push_back(constraint);
  }
  graph.unaligned = {CellId{5}, CellId{6}};
  const PoseGraph before = graph;
  Junction junction;
  junction.island = {1};  // the elder asked
  junction.other = {5};
  junction.T_other_island = upright_pose(10, -3, 1);
  bring_together(graph, junction);
  EXPECT_TRUE(graph.unaligned.empty());
  EXPECT_EQ(graph.nodes.at({1}).matrix(), before.nodes.at({1}).matrix());
  EXPECT_EQ(graph.nodes.at({2}).matrix(), before.nodes.at({2}).matrix());
  for (const std::uint32_t id : {5u, 6u}) {
    const Pose expected = junction.T_other_island.inverse() * before.nodes.at({id});
    EXPECT_TRUE(graph.nodes.at({id}).isApprox(expected, 1e-12));
  }
}

}  // namespace
}  // namespace cellmap
