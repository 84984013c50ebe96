#include "cellmap/scan/part_of_drive.hpp"

#include <gtest/gtest.h>

#include "support/expect_error.hpp"

namespace cellmap {
namespace {

/// Ten scans, each with one point that names it, a metre apart.
class Numbers : public ScanSource {
 public:
  Numbers() {
    std::vector<StampedPose> truth;
    for (std::size_t i = 0; i < size(); ++i) {
      truth.push_back({static_cast<Stamp>(i), Pose(Eigen::Translation3d(double(i), 7, 0))});
    }
    truth_ = Trajectory(std::move(truth));
  }
  std::size_t size() const override { return 10; }
  std::optional<PosedScan> next() override {
    if (next_ >= size()) return std::nullopt;
    PosedScan scan;
    scan.index = next_++;
    scan.T_odom_sensor = Pose(Eigen::Translation3d(double(scan.index), 0, 0)) *
                         Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ());
    scan.points.push_back(Eigen::Vector3f(float(scan.index), 0, 0));
    return scan;
  }
  void seek(std::size_t index) override { next_ = index; }
  const Trajectory& ground_truth() const override { return truth_; }

 private:
  std::size_t next_ = 0;
  Trajectory truth_;
};

TEST(PartOfDrive, IsADriveOfItsOwn) {
  const auto part = part_of_drive(std::make_unique<Numbers>(), 4, 3);
  EXPECT_EQ(part->size(), 3u);
  for (std::size_t i = 0; i < 3; ++i) {
    const auto scan = part->next();
    ASSERT_TRUE(scan);
    EXPECT_EQ(scan->index, i);
    EXPECT_EQ(scan->points[0].x(), float(4 + i));
    // Its first pose is the identity, and the steps are those of the drive seen from there.
    const Eigen::Vector3d expected =
        Eigen::AngleAxisd(-0.5, Eigen::Vector3d::UnitZ()) * Eigen::Vector3d(double(i), 0, 0);
    EXPECT_TRUE(scan->T_odom_sensor.translation().isApprox(expected, 1e-12) || i == 0);
  }
  EXPECT_FALSE(part->next());
  ASSERT_EQ(part->ground_truth().size(), 3u);
  EXPECT_EQ(part->ground_truth().poses()[0].pose.translation().x(), 4.0);
}

TEST(PartOfDrive, SeeksWithinItselfAndKeepsItsFrame) {
  const auto part = part_of_drive(std::make_unique<Numbers>(), 4, 0);
  EXPECT_EQ(part->size(), 6u);
  part->seek(2);
  const auto scan = part->next();
  EXPECT_EQ(scan->index, 2u);
  EXPECT_NEAR(scan->T_odom_sensor.translation().norm(), 2.0, 1e-12);
  part->seek(0);
  EXPECT_EQ(part->next()->index, 0u);
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { part->seek(7); }, "6 scans");
}

TEST(PartOfDrive, MustBeginWithinTheDrive) {
  test::expect_error(
      ErrorCode::kInvalidArgument, [] { part_of_drive(std::make_unique<Numbers>(), 10, 1); },
      "10 scans");
  EXPECT_EQ(part_of_drive(std::make_unique<Numbers>(), 9, 5)->size(), 1u);
}

}  // namespace
}  // namespace cellmap
