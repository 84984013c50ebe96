#include "cellmap/place/polar_image.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cellmap {
namespace {

/// Heights relative to the sensor, between deep ground and what a car's LiDAR sees of a house.
constexpr float kLowestM = -3.0f, kHighestM = 10.0f;
constexpr double kRecentringStepM = 2.0;
/// Of a scan in nine images; a bin is 4 m by 6 deg and needs no more to be described.
constexpr std::size_t kMostImagePoints = 20'000;

/// Mean 0 and squared norm 1/2, so that the correlations of two halves add up to at most 1.
void normalise(std::span<float> values) {
  double sum = 0;
  for (const float value : values) sum += value;
  const float mean = static_cast<float>(sum / static_cast<double>(values.size()));
  double squares = 0;
  for (float& value : values) {
    value -= mean;
    squares += static_cast<double>(value) * value;
  }
  if (!(squares > 0)) return;
  const float scale = static_cast<float>(std::sqrt(0.5 / squares));
  for (float& value : values) value *= scale;
}

}  // namespace

PolarImage::PolarImage(const PointCloud& points, const Eigen::Vector2d& centre)
    : bins_(kRows * kSectors, 0.0f) {
  const auto heights = std::span(bins_).first(kRings * kSectors);
  const auto counts = std::span(bins_).last(kRings * kSectors);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double x = points.x[i] - centre.x(), y = points.y[i] - centre.y();
    const double range = std::sqrt(x * x + y * y);
    if (!(range < kMaxRangeM)) continue;
    const auto ring = static_cast<std::size_t>(range / kMaxRangeM * kRings);
    const double turn = std::atan2(y, x) / (2 * std::numbers::pi) + 0.5;
    const auto sector = std::min(static_cast<std::size_t>(turn * kSectors), kSectors - 1);
    const std::size_t bin = std::min(ring, kRings - 1) * kSectors + sector;
    heights[bin] = std::max(heights[bin], std::clamp(points.z[i], kLowestM, kHighestM) - kLowestM);
    counts[bin] += 1;
  }
  for (float& count : counts) count = std::log1p(count);
  normalise(heights);
  normalise(counts);
}

std::vector<float> PolarImage::correlate(const PolarImage& other) const {
  std::vector<float> agreement(kSectors, 0.0f);
  std::vector<float> doubled(2 * kSectors);
  for (std::size_t row = 0; row < kRows; ++row) {
    const float* mine = &bins_[row * kSectors];
    const float* theirs = &other.bins_[row * kSectors];
    std::copy(mine, mine + kSectors, doubled.begin());
    std::copy(mine, mine + kSectors, doubled.begin() + kSectors);
    // Along the shift, not along the sector: the inner loop has no sum to wait for.
    for (std::size_t s = 0; s < kSectors; ++s) {
      const float value = theirs[s];
      if (value == 0.0f) continue;
      for (std::size_t k = 0; k < kSectors; ++k) agreement[k] += value * doubled[s + k];
    }
  }
  return agreement;
}

RecentredImages::RecentredImages(const PointCloud& full_scan) {
  const PointCloud scan = every_nth(full_scan, full_scan.size() / kMostImagePoints + 1);
  for (const int i : {0, -1, 1}) {
    for (const int j : {0, -1, 1}) {
      const Eigen::Vector2d centre = kRecentringStepM * Eigen::Vector2d(i, j);
      copies_.push_back({centre, PolarImage(scan, centre)});
    }
  }
}

std::vector<Alignment> RecentredImages::align(const PolarImage& cell, std::size_t count) const {
  constexpr std::size_t kSectors = PolarImage::kSectors;
  std::vector<Alignment> found;
  for (const Copy& copy : copies_) {
    const std::vector<float> agreement = cell.correlate(copy.image);
    for (std::size_t k = 0; k < kSectors; ++k) {
      const float before = agreement[(k + kSectors - 1) % kSectors];
      const float after = agreement[(k + 1) % kSectors];
      if (agreement[k] < before || agreement[k] <= after) continue;
      // The copy's centre comes to lie on the CELL's origin: p_cell = R (p_scan - centre).
      const double yaw = 2 * std::numbers::pi * static_cast<double>(k) / kSectors;
      const Pose turned = upright_pose(0, 0, yaw);
      const Eigen::Vector3d t = turned * Eigen::Vector3d(-copy.centre.x(), -copy.centre.y(), 0);
      found.push_back({upright_pose(t.x(), t.y(), yaw), agreement[k]});
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const Alignment& a, const Alignment& b) {
    return a.similarity > b.similarity;
  });
  if (found.size() > count) found.resize(count);
  return found;
}

Pose upright_pose(double x, double y, double yaw_rad) {
  Pose T = Pose::Identity();
  T.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  T.translation() << x, y, 0;
  return T;
}

double yaw_of(const Pose& T) { return std::atan2(T.linear()(1, 0), T.linear()(0, 0)); }

}  // namespace cellmap
