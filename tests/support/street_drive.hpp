#pragma once

#include "cellmap/evaluation/compared_drive.hpp"
#include "support/box_scene.hpp"

namespace cellmap::test {

/// Scans along a street of boxes, one each 2 m, seen from where they are said to be.
class StreetDrive : public ScanSource {
 public:
  explicit StreetDrive(std::size_t scans, double noise_m = 0.01) {
    BoxScene::Sensor sensor;
    sensor.beams = 40;
    sensor.azimuths = 600;
    sensor.noise_m = noise_m;
    std::vector<StampedPose> truth;
    for (std::size_t i = 0; i < scans; ++i) {
      sensor.seed = static_cast<unsigned>(i + 1);
      const Pose T = level_pose(2.0 * static_cast<double>(i), 0.1 * static_cast<double>(i % 3),
                                static_cast<double>(i % 4));
      scans_.push_back(street().scan(T, sensor));
      truth.push_back({static_cast<Stamp>(i) * 100'000'000, T});
    }
    truth_ = Trajectory(std::move(truth));
  }

  std::size_t size() const override { return scans_.size(); }
  std::optional<PosedScan> next() override {
    if (at_ == scans_.size()) return std::nullopt;
    const StampedPose& pose = truth_[at_];
    return PosedScan{at_, pose.stamp, pose.pose, scans_[at_++]};
  }
  void seek(std::size_t index) override { at_ = index; }
  const Trajectory& ground_truth() const override { return truth_; }

 private:
  std::vector<PointCloud> scans_;
  Trajectory truth_;
  std::size_t at_ = 0;
};

inline ComparedDrive street_drive(std::size_t scans, std::size_t held_back) {
  StreetDrive source(scans);
  return read_compared_drive(source, {}, held_back, true);
}

}  // namespace cellmap::test
