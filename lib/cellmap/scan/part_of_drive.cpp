#include "cellmap/scan/part_of_drive.hpp"

#include <algorithm>
#include <optional>
#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

class PartOfDrive final : public ScanSource {
 public:
  PartOfDrive(std::unique_ptr<ScanSource> drive, std::size_t first, std::size_t end)
      : drive_(std::move(drive)), first_(first), end_(end) {
    const auto& truth = drive_->ground_truth().poses();
    if (truth.size() >= end_) {
      truth_ = Trajectory({truth.begin() + static_cast<std::ptrdiff_t>(first_),
                           truth.begin() + static_cast<std::ptrdiff_t>(end_)});
    }
    seek(0);
  }

  std::size_t size() const override { return end_ - first_; }

  std::optional<PosedScan> next() override {
    if (next_ >= end_) return std::nullopt;
    if (!T_first_odom_) set_frame();
    auto scan = drive_->next();
    if (!scan) return scan;
    next_ = scan->index + 1;
    scan->index -= first_;
    scan->T_odom_sensor = *T_first_odom_ * scan->T_odom_sensor;
    return scan;
  }

  void seek(std::size_t index) override {
    if (index > size()) {
      throw Error(ErrorCode::kInvalidArgument, "the part of the drive has " +
                                                   std::to_string(size()) + " scans, not " +
                                                   std::to_string(index));
    }
    next_ = first_ + index;
    drive_->seek(next_);
  }

  const Trajectory& ground_truth() const override { return truth_; }

 private:
  /// The first scan of the part has the pose that all others are told in.
  void set_frame() {
    drive_->seek(first_);
    if (const auto scan = drive_->next()) T_first_odom_ = scan->T_odom_sensor.inverse();
    drive_->seek(next_);
  }

  std::unique_ptr<ScanSource> drive_;
  std::size_t first_, end_, next_ = 0;
  std::optional<Pose> T_first_odom_;
  Trajectory truth_;
};

}  // namespace

std::unique_ptr<ScanSource> part_of_drive(std::unique_ptr<ScanSource> drive, std::size_t first,
                                          std::size_t count) {
  const std::size_t size = drive->size();
  if (first >= size) {
    throw Error(ErrorCode::kInvalidArgument, "the drive has " + std::to_string(size) +
                                                 " scans; a part of it cannot begin at scan " +
                                                 std::to_string(first));
  }
  const std::size_t left = size - first;
  const std::size_t taken = count == 0 ? left : std::min(count, left);
  return std::make_unique<PartOfDrive>(std::move(drive), first, first + taken);
}

}  // namespace cellmap
