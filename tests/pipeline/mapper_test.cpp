#include "cellmap/pipeline/mapper.hpp"

#include <gtest/gtest.h>

#include <set>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/evaluation/trajectory_metrics.hpp"
#include "cellmap/pipeline/refine.hpp"
#include "support/expect_error.hpp"
#include "support/town_drive.hpp"

namespace cellmap {
namespace {

using test::BuiltMap;
using test::TownDrive;

double ape(const BuiltMap& map, const std::vector<Pose>& truth) {
  std::vector<CellScans> stretches;
  for (const CellUpdate& update : map.updates) {
    stretches.push_back({update.id, update.cell->T_odom_cell, update.scans});
  }
  std::vector<Pose> estimate;
  const Trajectory corrected = corrected_trajectory(stretches, map.graph.nodes);
  for (const StampedPose& pose : corrected.poses()) estimate.push_back(pose.pose);
  return evaluate_trajectory(estimate, truth).ape_rmse_m;
}

BuiltMap build(const MapperOptions& options) {
  BuiltMap map;
  const auto source = TownDrive().open();
  Mapper mapper(options, "drive", map.lattice, {}, map.access());
  build_map(*source, mapper, [&](CellUpdate&& update) { map.add(std::move(update)); });
  return map;
}

class MapperOnATownDrive : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    map_ = std::make_unique<BuiltMap>(build(test::quick_mapper_options()));
  }
  static void TearDownTestSuite() { map_.reset(); }
  static std::unique_ptr<BuiltMap> map_;
};
std::unique_ptr<BuiltMap> MapperOnATownDrive::map_;

TEST_F(MapperOnATownDrive, EachStageBringsTheTrajectoryNearerToTheTruth) {
  const std::vector<Pose> truth = TownDrive().truth();
  const double before = evaluate_trajectory(TownDrive().odometry(), truth).ape_rmse_m;
  MapperOptions without_loops = test::quick_mapper_options();
  without_loops.loop_closures = false;
  const double bidirectional = ape(build(without_loops), truth);
  const double after = ape(*map_, truth);
  EXPECT_LT(bidirectional, 0.7 * before);
  // 28 CELLs: one marginal loop more or less moves this by a tenth of a metre.
  EXPECT_LT(after, 0.5 * bidirectional);
}

TEST_F(MapperOnATownDrive, EveryConstraintIsNearTheTruth) {
  const std::vector<Pose> truth = TownDrive().truth();
  std::map<CellId, Pose> T_world_cell;
  for (const CellUpdate& update : map_->updates) {
    T_world_cell[update.id] = truth.at(update.cell->first_scan);
  }
  std::set<ConstraintKind> kinds;
  for (const Constraint& c : map_->graph.constraints) {
    validate(c);
    kinds.insert(c.kind);
    const Pose T_true = T_world_cell[c.from].inverse() * T_world_cell[c.to];
    EXPECT_LT((T_true.translation() - c.T_from_to.translation()).norm(), 0.2)
        << to_string(c.kind) << ' ' << c.from.value << ' ' << c.to.value;
  }
  EXPECT_TRUE(kinds.contains(ConstraintKind::kLoop));
  EXPECT_TRUE(kinds.contains(ConstraintKind::kBidirectional));
}

TEST_F(MapperOnATownDrive, CellsFollowEachOtherWithoutAGap) {
  std::uint32_t next_scan = 0, next_sequence = 0;
  for (const CellUpdate& update : map_->updates) {
    EXPECT_EQ(update.cell->first_scan, next_scan);
    EXPECT_EQ(update.cell->sequence, next_sequence++);
    EXPECT_EQ(update.cell->scan_count, update.scans.size());
    EXPECT_GT(update.raw_points, 0u);
    next_scan += update.cell->scan_count;
  }
  EXPECT_EQ(next_scan, TownDrive().scans());
}

TEST_F(MapperOnATownDrive, PosesCarryOnlyTheNewCellAndWhatMoved) {
  std::map<CellId, Pose> known;
  for (const CellUpdate& update : map_->updates) {
    EXPECT_TRUE(update.poses.contains(update.id));
    bool has_loop = false;
    for (const Constraint& c : update.constraints) has_loop |= c.kind == ConstraintKind::kLoop;
    EXPECT_TRUE(has_loop || update.poses.size() == 1u);
    for (const auto& [id, T] : update.poses) {
      EXPECT_FALSE(known.contains(id) && known[id].matrix() == T.matrix());
      known[id] = T;
    }
  }
}

TEST_F(MapperOnATownDrive, AResumedDriveEndsAsAnUndisturbedOne) {
  const std::size_t stop_after = map_->updates.size() - 4;
  BuiltMap resumed;
  for (std::size_t i = 0; i < stop_after; ++i) {
    CellUpdate update = map_->updates[i];
    // As a store gives it back: decoded, not shared.
    update.cell = std::make_shared<const Cell>(decode_cell(encode_cell(*update.cell).bytes));
    resumed.add(std::move(update));
  }
  const CellUpdate last = resumed.updates.back();
  const auto source = TownDrive().open();
  Mapper mapper(test::quick_mapper_options(), "drive", resumed.lattice, resumed.graph,
                resumed.access());
  source->seek(last.cell->first_scan);
  mapper.resume_after(last.id, last.cell, *source->next());
  source->seek(last.cell->first_scan + last.cell->scan_count);
  build_map(*source, mapper, [&](CellUpdate&& update) { resumed.add(std::move(update)); });

  ASSERT_EQ(resumed.updates.size(), map_->updates.size());
  for (std::size_t i = 0; i < resumed.updates.size(); ++i) {
    EXPECT_EQ(encode_cell(*resumed.updates[i].cell).hash, encode_cell(*map_->updates[i].cell).hash);
  }
  ASSERT_EQ(resumed.graph.constraints.size(), map_->graph.constraints.size());
  for (std::size_t i = 0; i < resumed.graph.constraints.size(); ++i) {
    const Constraint &a = resumed.graph.constraints[i], &b = map_->graph.constraints[i];
    EXPECT_EQ(a.T_from_to.matrix(), b.T_from_to.matrix());
    EXPECT_EQ(a.information, b.information);
  }
  for (const auto& [id, T] : map_->graph.nodes) {
    EXPECT_EQ(resumed.graph.nodes.at(id).matrix(), T.matrix());
  }
}

TEST(Mapper, RefusesToResumeFromAnotherScan) {
  BuiltMap map;
  auto cell = std::make_shared<Cell>();
  cell->first_scan = 7;
  PosedScan scan;
  scan.index = 6;
  PoseGraph graph;
  graph.nodes[{1}] = Pose::Identity();
  Mapper mapper({}, "drive", map.lattice, graph, map.access());
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { mapper.resume_after({1}, cell, scan); }, "scan 7",
      "scan 6");
}

TEST(Mapper, AStopRequestEndsTheBuildAsCancelled) {
  BuiltMap map;
  const auto source = TownDrive{.laps = 0.2}.open();
  Mapper mapper(test::quick_mapper_options(), "drive", map.lattice, {}, map.access());
  std::stop_source stop;
  std::size_t scans = 0;
  test::expect_error(
      ErrorCode::kCancelled,
      [&] {
        build_map(
            *source, mapper, [&](CellUpdate&&) {}, stop.get_token(),
            [&](const Progress& progress) {
              scans = progress.scans_done;
              if (scans == 3) stop.request_stop();
            });
      },
      "");
  EXPECT_EQ(scans, 3u);
}

TEST(Mapper, ADriveOfNoScansHasNoCell) {
  BuiltMap map;
  Mapper mapper({}, "drive", map.lattice, {}, map.access());
  EXPECT_FALSE(mapper.finish().has_value());
}

}  // namespace
}  // namespace cellmap
