#include "cellmap/change/diff.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "cellmap/core/error.hpp"
#include "support/two_days.hpp"

namespace cellmap {
namespace {

using test::BoxScene;
using test::is_on;
using test::level_pose;
using test::street_with;

const BoxScene::Box& kCar = test::kParkedCar;

/// CELLs seen on two days, and the scene of each.
class TwoDays {
 public:
  std::vector<PlacedCell> earlier, later;

  void see(std::vector<PlacedCell>& day, const BoxScene& scene, const Pose& T_world_cell,
           const Pose& pose_error = Pose::Identity()) {
    const CellId id{static_cast<std::uint32_t>(targets_.size() + 1)};
    const Cell cell = test::cell_seen(scene, T_world_cell, *lattice_, id.value);
    targets_[id] =
        std::make_shared<const RegistrationTarget>(std::make_shared<const Cell>(cell), lattice_);
    truth_[id] = T_world_cell;
    day.push_back({id, T_world_cell * pose_error});
  }

  SessionDiff diff(DiffOptions options = {}) const {
    return diff_sessions(earlier, later, targets(), options);
  }
  TargetProvider targets() const {
    return [this](CellId id) { return targets_.at(id); };
  }

  /// The middles of those patches of a CELL that became `change`, world frame.
  std::vector<Eigen::Vector3d> patches(const CellDiff& diff, PatchChange change) const {
    const RegistrationTarget& target = *targets_.at(diff.cell);
    std::vector<Eigen::Vector3d> middles;
    for (std::size_t i = 0; i < diff.patches.size(); ++i) {
      if (diff.patches[i] != change) continue;
      middles.push_back(truth_.at(diff.cell) *
                        (static_cast<double>(target.cell().planes[i].distance_m) *
                         lattice_->direction(target.cell().indices[i])));
    }
    return middles;
  }

 private:
  std::shared_ptr<const Lattice> lattice_ =
      std::make_shared<const Lattice>(LatticeSpec{LatticeKind::kFibonacci, 20'000});
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> targets_;
  std::map<CellId, Pose> truth_;
};

std::size_t count_on(const BoxScene::Box& box, const std::vector<Eigen::Vector3d>& patches) {
  return static_cast<std::size_t>(
      std::ranges::count_if(patches, [&](const auto& p) { return is_on(box, p, 0.1); }));
}

TEST(SessionDiff, WhereNothingChangedNothingIsCalledChanged) {
  TwoDays days;
  days.see(days.earlier, test::street(), level_pose(0, 0, 0));
  days.see(days.later, test::street(), level_pose(2.5, 0.8, 20));
  const SessionDiff diff = days.diff();
  EXPECT_EQ(diff.pairs, 1u);
  EXPECT_TRUE(diff.regions.empty());
  for (const CellDiff& cell : {diff.earlier[0], diff.later[0]}) {
    EXPECT_TRUE(cell.changed.empty());
    EXPECT_GT(cell.count(PatchChange::kStayed), cell.patches.size() / 2);
  }
}

TEST(SessionDiff, ACarThatIsGoneVanishesAndNothingElse) {
  TwoDays days;
  days.see(days.earlier, street_with({kCar}), level_pose(0, 0, 0));
  days.see(days.later, test::street(), level_pose(3, 0.5, -15));
  const SessionDiff diff = days.diff();
  const auto vanished = days.patches(diff.earlier[0], PatchChange::kVanished);
  ASSERT_GT(vanished.size(), 10u);
  EXPECT_EQ(count_on(kCar, vanished), vanished.size());
  EXPECT_EQ(diff.earlier[0].changed.size(), vanished.size());
  EXPECT_TRUE(diff.later[0].changed.empty());
}

TEST(SessionDiff, ACarThatCameAppearsWhereTheOtherOrderSaysThatItVanished) {
  TwoDays days;
  days.see(days.earlier, test::street(), level_pose(3, 0.5, -15));
  days.see(days.later, street_with({kCar}), level_pose(0, 0, 0));
  const SessionDiff came = days.diff();
  std::swap(days.earlier, days.later);
  const SessionDiff went = days.diff();
  EXPECT_TRUE(came.earlier[0].changed.empty());
  EXPECT_GT(days.patches(came.later[0], PatchChange::kAppeared).size(), 10u);
  EXPECT_EQ(came.later[0].changed.size(),
            days.patches(came.later[0], PatchChange::kAppeared).size());
  // Registration begins from the other side, so a patch at a threshold may differ.
  EXPECT_NEAR(static_cast<double>(went.earlier[0].changed.size()),
              static_cast<double>(came.later[0].changed.size()), 3);
}

TEST(SessionDiff, AChangedPlaceIsOneRegionOfTheRightSize) {
  TwoDays days;
  for (const double x : {0.0, 6.0}) {
    days.see(days.earlier, street_with({kCar}), level_pose(x, 0, 0));
    days.see(days.later, test::street(), level_pose(x + 2, 0.3, 5));
  }
  const SessionDiff diff = days.diff();
  ASSERT_EQ(diff.regions.size(), 1u);
  const ChangeRegion& region = diff.regions[0];
  EXPECT_EQ(region.change, PatchChange::kVanished);
  EXPECT_TRUE(is_on(kCar, region.centroid, 0));
  EXPECT_TRUE(is_on(kCar, region.box.min(), 0.1) && is_on(kCar, region.box.max(), 0.1));
  EXPECT_GT(region.box.sizes().x(), 3);  // of 4.2 m
  EXPECT_THAT(region.cells, testing::ElementsAre(CellId{1}, CellId{3}));
  // Its side is 6.3 m^2, its end 2.7; edges are not judged.
  EXPECT_GT(region.area_m2, 2);
  EXPECT_LT(region.area_m2, 9.5);
}

TEST(SessionDiff, WhatIsHiddenIsNeverSeen) {
  // The car is gone, but a lorry stands between the place and whoever looks.
  const BoxScene::Box lorry{{4, 1.6, -1.7}, {14, 2.4, 2}};
  TwoDays days;
  days.see(days.earlier, street_with({kCar}), level_pose(0, 0, 0));
  days.see(days.later, street_with({lorry}), level_pose(3, 0, 0));
  const SessionDiff diff = days.diff();
  EXPECT_EQ(count_on(kCar, days.patches(diff.earlier[0], PatchChange::kVanished)), 0u);
  const auto appeared = days.patches(diff.later[0], PatchChange::kAppeared);
  EXPECT_GT(count_on(lorry, appeared), 10u);
  EXPECT_EQ(count_on(lorry, appeared), appeared.size());
}

TEST(SessionDiff, OneWitnessOutweighsTheOthers) {
  // One CELL of the later day still saw the car, another one looked through its place.
  TwoDays days;
  days.see(days.earlier, street_with({kCar}), level_pose(0, 0, 0));
  days.see(days.later, street_with({kCar}), level_pose(1, 0, 0));
  days.see(days.later, test::street(), level_pose(3, 0, 0));
  const SessionDiff diff = days.diff();
  EXPECT_EQ(diff.pairs, 2u);
  EXPECT_TRUE(diff.earlier[0].changed.empty());
  EXPECT_GT(count_on(kCar, days.patches(diff.earlier[0], PatchChange::kStayed)), 10u);
}

TEST(SessionDiff, AbsorbsErrorsOfTheMapsPoses) {
  Pose error = level_pose(0.12, -0.1, 0.4);
  error.translation().z() = 0.1;
  TwoDays days;
  days.see(days.earlier, street_with({kCar}), level_pose(0, 0, 0));
  days.see(days.later, test::street(), level_pose(3, 0.5, -15), error);
  const auto vanished = days.patches(days.diff().earlier[0], PatchChange::kVanished);
  EXPECT_GT(vanished.size(), 10u);
  EXPECT_EQ(count_on(kCar, vanished), vanished.size());
}

TEST(SessionDiff, CellsOutOfReachAreNotCompared) {
  TwoDays days;
  days.see(days.earlier, street_with({kCar}), level_pose(0, 0, 0));
  days.see(days.later, test::street(), level_pose(20, 0, 0));
  const SessionDiff diff = days.diff();
  EXPECT_EQ(diff.pairs, 0u);
  EXPECT_EQ(diff.earlier[0].count(PatchChange::kNeverSeen), diff.earlier[0].patches.size());
  EXPECT_GT(diff.earlier[0].patches.size(), 0u);
}

TEST(SessionDiff, IsTheSameForAnyNumberOfThreads) {
  TwoDays days;
  for (const double x : {0.0, 4.0, 9.0}) {
    days.see(days.earlier, street_with({kCar}), level_pose(x, 0, 0));
    days.see(days.later, test::street(), level_pose(x + 1, 0.4, 3));
  }
  DiffOptions serial, parallel;
  serial.threads = 1;
  parallel.threads = 2;
  const SessionDiff one = days.diff(serial), two = days.diff(parallel);
  for (std::size_t i = 0; i < one.earlier.size(); ++i) {
    EXPECT_EQ(one.earlier[i].patches, two.earlier[i].patches);
    EXPECT_EQ(one.later[i].patches, two.later[i].patches);
  }
}

TEST(SessionDiff, EachCellIsComparedWithItsNearest) {
  std::vector<PlacedCell> earlier, later;
  for (std::uint32_t i = 0; i < 6; ++i) {
    earlier.push_back({CellId{i}, level_pose(6.0 * i, 0, 0)});
    later.push_back({CellId{100 + i}, level_pose(6.0 * i + 1, 0, 0)});
  }
  DiffOptions options;
  options.views = 1;
  const auto pairs = pairs_to_compare(earlier, later, options);
  ASSERT_EQ(pairs.size(), 6u);
  for (const CellPair& pair : pairs) EXPECT_EQ(pair.earlier, pair.later);
  // And 5 m away the later one before (of the first: the one behind, 7 m), and seen from the later
  // ones the earlier one behind (of the last: the one before): 5 pairs that both ask for, and 2.
  options.views = 2;
  EXPECT_EQ(pairs_to_compare(earlier, later, options).size(), 6u + 5u + 2u);
}

TEST(SessionDiff, StopsOnRequest) {
  TwoDays days;
  days.see(days.earlier, test::street(), level_pose(0, 0, 0));
  days.see(days.later, test::street(), level_pose(1, 0, 0));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(diff_sessions(days.earlier, days.later, days.targets(), {}, stop.get_token()),
               Error);
}

TEST(SessionDiff, OptionsOutOfRangeAreRefused) {
  const auto refused = [](auto change) {
    DiffOptions options;
    change(options);
    EXPECT_THROW(options.validate(), Error);
  };
  refused([](DiffOptions& o) { o.reach_m = 0; });
  refused([](DiffOptions& o) { o.views = 0; });
  refused([](DiffOptions& o) { o.margin_m = o.stayed_distance_m; });
  refused([](DiffOptions& o) { o.clear_directions = 8; });
  refused([](DiffOptions& o) { o.threads = -1; });
  EXPECT_NO_THROW(DiffOptions{}.validate());
}

}  // namespace
}  // namespace cellmap
