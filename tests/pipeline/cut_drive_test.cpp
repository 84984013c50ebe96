#include "cellmap/pipeline/cut_drive.hpp"

#include <gtest/gtest.h>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/pipeline/front_end.hpp"
#include "support/town_drive.hpp"

namespace cellmap {
namespace {

using test::TownDrive;

/// The scans of a simulated drive; the filter leaves nothing of every fourth one.
std::vector<PosedScan> scans() {
  std::vector<PosedScan> all;
  const auto source = TownDrive().open();
  while (auto scan = source->next()) {
    if (scan->index % 4 == 3) {
      for (float& z : scan->points.z) z += 1e5f;
    }
    all.push_back(std::move(*scan));
  }
  return all;
}

std::vector<Pose> poses(const std::vector<PosedScan>& scans) {
  std::vector<Pose> all;
  for (const PosedScan& scan : scans) all.push_back(scan.T_odom_sensor);
  return all;
}

std::vector<FinishedCell> cells_of(FrontEnd& front, std::span<const PosedScan> scans) {
  std::vector<FinishedCell> cells;
  for (const PosedScan& scan : scans) {
    if (auto cell = front.add(scan)) cells.push_back(std::move(*cell));
  }
  if (auto cell = front.finish()) cells.push_back(std::move(*cell));
  return cells;
}

std::vector<DriveStretch> stretches_of(const std::vector<FinishedCell>& cells) {
  std::vector<DriveStretch> stretches;
  for (const FinishedCell& finished : cells) {
    const Cell& cell = finished.cell();
    stretches.push_back({cell.sequence, cell.first_scan, cell.scan_count});
  }
  return stretches;
}

class CutDrive : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    scans_ = std::make_unique<std::vector<PosedScan>>(scans());
    FrontEnd front = test::quick_front_end();
    cells_ = std::make_unique<std::vector<FinishedCell>>(cells_of(front, *scans_));
  }
  static void TearDownTestSuite() {
    scans_.reset();
    cells_.reset();
  }
  static double distance_m() { return test::quick_mapper_options().cell_distance_m; }
  static std::span<const PosedScan> scans_of(const DriveStretch& first, const DriveStretch& last) {
    return std::span(*scans_).subspan(first.first_scan,
                                      last.first_scan + last.scan_count - first.first_scan);
  }

  static std::unique_ptr<std::vector<PosedScan>> scans_;
  static std::unique_ptr<std::vector<FinishedCell>> cells_;
};
std::unique_ptr<std::vector<PosedScan>> CutDrive::scans_;
std::unique_ptr<std::vector<FinishedCell>> CutDrive::cells_;

TEST_F(CutDrive, CutsWhereTheFrontEndCutsAndNumbersAsItDoes) {
  ASSERT_GT(cells_->size(), 20u);
  EXPECT_EQ(cut_drive(poses(*scans_), 0, 0, distance_m()), stretches_of(*cells_));
}

TEST_F(CutDrive, GoesOnAfterACellAsTheFrontEndDoes) {
  const Cell& last = cells_->at(7).cell();
  FrontEnd front = test::quick_front_end();
  front.resume_after(last);
  const std::uint64_t next = last.first_scan + last.scan_count;
  const auto rest = cells_of(front, std::span(*scans_).subspan(next));
  EXPECT_EQ(cut_drive(poses(*scans_), next, last.sequence + 1, distance_m()), stretches_of(rest));
  EXPECT_TRUE(cut_drive(poses(*scans_), scans_->size(), 30, distance_m()).empty());
}

TEST_F(CutDrive, RunsOfCellsMadeAloneAreThoseOfTheWholeDrive) {
  const auto cut = cut_drive(poses(*scans_), 0, 0, distance_m());
  SessionVoxels voxels;
  std::size_t made = 0;
  for (std::size_t first = 0; first < cut.size(); first += 3) {
    FrontEnd front = test::quick_front_end();
    front.begin_at(cut[first].sequence);
    const std::size_t last = std::min(first + 3, cut.size()) - 1;
    for (const FinishedCell& cell : cells_of(front, scans_of(cut[first], cut[last]))) {
      const FinishedCell& expected = cells_->at(made++);
      EXPECT_EQ(encode_cell(cell.cell()).bytes, encode_cell(expected.cell()).bytes);
      EXPECT_EQ(cell.raw_points, expected.raw_points);
      EXPECT_EQ(cell.points.x, expected.points.x);
      EXPECT_EQ(cell.voxels, expected.voxels);
      EXPECT_EQ(voxels.add(cell.voxels), expected.voxel_points);
      EXPECT_LE(expected.voxel_points, cell.points.size() * cell.scans.size());
    }
  }
  EXPECT_EQ(made, cells_->size());
}

}  // namespace
}  // namespace cellmap
