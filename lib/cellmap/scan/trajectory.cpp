#include "cellmap/scan/trajectory.hpp"

#include <algorithm>
#include <array>
#include <charconv>

#include "cellmap/core/error.hpp"
#include "cellmap/scan/text_table.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kKittiColumns = 12;
constexpr std::size_t kTumColumns = 8;
constexpr Stamp kDefaultPeriod = 100'000'000;  // 10 Hz, where nothing says better

template <std::size_t N>
std::array<double, N> numbers(const TextTable& table, const TextRow& row, std::size_t first) {
  std::array<double, N> values;
  for (std::size_t i = 0; i < N; ++i) values[i] = table.number(row, first + i);
  return values;
}

void expect_columns(const TextTable& table, const TextRow& row, std::size_t columns,
                    const char* format) {
  if (row.words.size() == columns) return;
  throw table.error(row, "expected a " + std::string(format) + " row of " +
                             std::to_string(columns) + " numbers, found " +
                             std::to_string(row.words.size()));
}

void expect_rows(const TextTable& table) {
  if (!table.rows().empty()) return;
  throw Error(ErrorCode::kCorruptData,
              table.file().string() + ": expected one pose a line, found none");
}

TrajectoryFormat format_of(const TextTable& table) {
  expect_rows(table);
  const TextRow& first = table.rows().front();
  if (first.words.size() == kKittiColumns) return TrajectoryFormat::kKitti;
  if (first.words.size() == kTumColumns) return TrajectoryFormat::kTum;
  throw table.error(first, "expected a KITTI row of 12 numbers or a TUM row of 8, found " +
                               std::to_string(first.words.size()));
}

Trajectory read_kitti(const TextTable& table, std::span<const Stamp> stamps) {
  expect_rows(table);
  const std::vector<TextRow>& rows = table.rows();
  if (!stamps.empty() && stamps.size() != rows.size()) {
    throw Error(ErrorCode::kCorruptData,
                table.file().string() + ": expected " + std::to_string(stamps.size()) +
                    " poses, one for each time, found " + std::to_string(rows.size()));
  }
  std::vector<StampedPose> poses(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    expect_columns(table, rows[i], kKittiColumns, "KITTI");
    poses[i].stamp = stamps.empty() ? static_cast<Stamp>(i) * kDefaultPeriod : stamps[i];
    try {
      poses[i].pose = pose_from_row_major_3x4(numbers<kKittiColumns>(table, rows[i], 0));
    } catch (const Error& error) {
      if (error.code() == ErrorCode::kCorruptData) throw;
      throw table.error(rows[i], error.what());
    }
  }
  return Trajectory(std::move(poses));
}

Trajectory read_tum(const TextTable& table) {
  expect_rows(table);
  std::vector<StampedPose> poses;
  poses.reserve(table.rows().size());
  for (const TextRow& row : table.rows()) {
    expect_columns(table, row, kTumColumns, "TUM");
    StampedPose pose;
    pose.stamp = table.seconds(row, 0);
    if (!poses.empty() && pose.stamp <= poses.back().stamp) {
      throw table.error(row, "expected a time after " + seconds_text(poses.back().stamp) +
                                 " s, found " + seconds_text(pose.stamp) + " s");
    }
    try {
      pose.pose = pose_from_xyz_qxyzw(numbers<7>(table, row, 1));
    } catch (const Error& error) {
      if (error.code() == ErrorCode::kCorruptData) throw;
      throw table.error(row, error.what());
    }
    poses.push_back(pose);
  }
  return Trajectory(std::move(poses));
}

/// The shortest text that reads back as the same double.
void append(std::string& text, double value) {
  std::array<char, 32> digits;
  const auto result = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  text.append(digits.data(), result.ptr);
}

void append_kitti_row(std::string& text, const Pose& pose) {
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      append(text, pose.matrix()(row, column));
      text += row == 2 && column == 3 ? '\n' : ' ';
    }
  }
}

void append_tum_row(std::string& text, const StampedPose& pose) {
  text += seconds_text(pose.stamp);
  for (const double value : to_xyz_qxyzw(pose.pose)) {
    text += ' ';
    append(text, value);
  }
  text += '\n';
}

}  // namespace

Trajectory::Trajectory(std::vector<StampedPose> poses) : poses_(std::move(poses)) {
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    if (!is_rigid(poses_[i].pose)) {
      throw Error(ErrorCode::kInvalidArgument,
                  "pose " + std::to_string(i) + " of a trajectory is not a rigid transform");
    }
    if (i > 0 && poses_[i].stamp <= poses_[i - 1].stamp) {
      throw Error(ErrorCode::kInvalidArgument, "the times of a trajectory must increase: pose " +
                                                   std::to_string(i) + " has " +
                                                   seconds_text(poses_[i].stamp) + " s after " +
                                                   seconds_text(poses_[i - 1].stamp) + " s");
    }
  }
}

std::optional<Pose> Trajectory::at(Stamp stamp) const {
  const auto after =
      std::lower_bound(poses_.begin(), poses_.end(), stamp,
                       [](const StampedPose& pose, Stamp wanted) { return pose.stamp < wanted; });
  if (after == poses_.end()) return std::nullopt;
  if (after->stamp == stamp) return after->pose;
  if (after == poses_.begin()) return std::nullopt;
  const auto before = after - 1;
  const double t = static_cast<double>(stamp - before->stamp) /
                   static_cast<double>(after->stamp - before->stamp);
  return interpolate(before->pose, after->pose, t);
}

double Trajectory::length_m() const {
  double length = 0;
  for (std::size_t i = 1; i < poses_.size(); ++i) {
    length += (poses_[i].pose.translation() - poses_[i - 1].pose.translation()).norm();
  }
  return length;
}

Trajectory read_kitti_trajectory(const std::filesystem::path& file, std::span<const Stamp> stamps) {
  return read_kitti(TextTable(file), stamps);
}

Trajectory read_tum_trajectory(const std::filesystem::path& file) {
  return read_tum(TextTable(file));
}

TrajectoryFormat trajectory_format(const std::filesystem::path& file) {
  return format_of(TextTable(file));
}

Trajectory read_trajectory(const std::filesystem::path& file, std::span<const Stamp> stamps) {
  const TextTable table(file);
  return format_of(table) == TrajectoryFormat::kKitti ? read_kitti(table, stamps) : read_tum(table);
}

std::string to_text(const Trajectory& trajectory, TrajectoryFormat format) {
  std::string text;
  for (const StampedPose& pose : trajectory.poses()) {
    if (format == TrajectoryFormat::kKitti) {
      append_kitti_row(text, pose.pose);
    } else {
      append_tum_row(text, pose);
    }
  }
  return text;
}

void write_trajectory(const std::filesystem::path& file, const Trajectory& trajectory,
                      TrajectoryFormat format) {
  write_file(file, to_text(trajectory, format));
}

}  // namespace cellmap
