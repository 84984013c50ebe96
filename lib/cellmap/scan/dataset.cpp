#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include "cellmap/core/error.hpp"
#include "cellmap/scan/scan_files.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "cellmap/scan/text_table.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr Stamp kAssumedPeriod = 100'000'000;  // 10 Hz

/// Everything about a drive but its points.
struct Recording {
  ScanFiles scans;
  std::vector<Stamp> stamps;  ///< one a scan
  std::vector<Pose> poses;    ///< T_odom_sensor, one a scan
  Trajectory truth;           ///< T_world_sensor
};

class RecordedDrive final : public ScanSource {
 public:
  RecordedDrive(Recording recording, ScanFileReader reader)
      : recording_(std::move(recording)), reader_(std::move(reader)) {}

  std::size_t size() const override { return recording_.poses.size(); }

  std::optional<PosedScan> next() override {
    if (next_ == size()) return std::nullopt;
    const fs::path& file = recording_.scans.files[next_];
    PosedScan scan{next_, recording_.stamps[next_], recording_.poses[next_], reader_(file)};
    if (scan.points.size() > kMaxScanPoints) {
      throw Error(ErrorCode::kTooLarge, file.string() + ": expected a scan of at most " +
                                            std::to_string(kMaxScanPoints) + " points, found " +
                                            std::to_string(scan.points.size()));
    }
    if (scan.points.empty()) {
      throw Error(ErrorCode::kCorruptData, file.string() + ": expected a scan, found no points");
    }
    ++next_;
    return scan;
  }

  void seek(std::size_t index) override {
    if (index > size()) {
      throw Error(ErrorCode::kInvalidArgument, "cannot go to scan " + std::to_string(index) +
                                                   " of a drive of " + std::to_string(size()));
    }
    next_ = index;
  }

  std::span<const Pose> odometry() const override { return recording_.poses; }

  const Trajectory& ground_truth() const override { return recording_.truth; }

 private:
  Recording recording_;
  ScanFileReader reader_;
  std::size_t next_ = 0;
};

/// Refuses `file` unless it has a row for each scan, and none too many where that would leave open
/// which rows are meant.
void expect_a_row_for_each(const ScanFiles& scans, const fs::path& file, std::size_t rows,
                           const std::string& what) {
  const std::size_t count = scans.files.size();
  const std::string found = file.string() + ": expected " + std::to_string(count) + " " + what +
                            ", one for each scan in " + scans.folder.string() + ", found " +
                            std::to_string(rows);
  if (rows < count) {
    throw Error(ErrorCode::kCorruptData,
                found + ": the first scan without one is " + scans.files[rows].filename().string());
  }
  if (rows > count && !scans.may_begin_a_longer_drive) {
    throw Error(ErrorCode::kCorruptData,
                found + ": further rows are ignored only where the scans are numbered 0, 1, 2, " +
                    "..., for here it is open which rows belong to them: give a file with the " +
                    "rows of these scans");
  }
}

/// The time of each scan: from times.txt, or nothing where there is no such file.
std::optional<std::vector<Stamp>> read_times(const ScanFiles& scans, const fs::path& file) {
  if (!fs::exists(file)) return std::nullopt;
  const TextTable table(file);
  std::vector<Stamp> stamps;
  stamps.reserve(table.rows().size());
  for (const TextRow& row : table.rows()) {
    if (row.words.size() != 1) {
      throw table.error(row, "expected one time in seconds, found " +
                                 std::to_string(row.words.size()) + " words");
    }
    const Stamp stamp = table.seconds(row, 0);
    if (!stamps.empty() && stamp <= stamps.back()) {
      throw table.error(row, "expected a time after " + seconds_text(stamps.back()) + " s, found " +
                                 seconds_text(stamp) + " s");
    }
    stamps.push_back(stamp);
  }
  expect_a_row_for_each(scans, file, stamps.size(), "times");
  stamps.resize(scans.files.size());
  return stamps;
}

/// Tr of a KITTI calib.txt: T_camera_sensor.
struct Calibration {
  fs::path file;
  bool file_exists = false;
  std::optional<Pose> T_camera_sensor;
};

Calibration read_calibration(const fs::path& file) {
  Calibration calibration{file, fs::exists(file), std::nullopt};
  if (!calibration.file_exists) return calibration;
  const TextTable table(file);
  for (const TextRow& row : table.rows()) {
    if (row.words[0] != "Tr:") continue;
    if (row.words.size() != 13) {
      throw table.error(
          row, "expected \"Tr:\" and 12 numbers, found " + std::to_string(row.words.size() - 1));
    }
    std::array<double, 12> values;
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = table.number(row, i + 1);
    try {
      calibration.T_camera_sensor = pose_from_row_major_3x4(values);
    } catch (const Error& error) {
      throw table.error(row, error.what());
    }
  }
  return calibration;
}

const Pose& require_Tr(const Calibration& calibration) {
  if (calibration.T_camera_sensor) return *calibration.T_camera_sensor;
  throw Error(ErrorCode::kInvalidArgument,
              calibration.file.string() +
                  ": poses in the camera frame need its line \"Tr: \" with 12 numbers, found " +
                  (calibration.file_exists ? "none" : "no such file") +
                  ": add it, or say that the poses are in the sensor frame");
}

/// The frame of a pose file that belongs to the folder: a folder with a camera calibration is a
/// KITTI folder, and KITTI gives poses of the camera.
PoseFrame own_frame(const Calibration& calibration) {
  if (!calibration.file_exists) return PoseFrame::kSensor;
  require_Tr(calibration);  // without it nothing says which frame is meant
  return PoseFrame::kCamera;
}

Pose to_sensor(const Pose& T_world_frame, PoseFrame frame, const Calibration& calibration) {
  if (frame == PoseFrame::kSensor) return T_world_frame;
  const Pose& Tr = require_Tr(calibration);
  return Tr.inverse() * T_world_frame * Tr;
}

/// The poses of `file` at the scans: row by row, or interpolated at their times.
std::vector<Pose> poses_at_scans(const fs::path& file, const ScanFiles& scans,
                                 const std::optional<std::vector<Stamp>>& times) {
  const Trajectory trajectory = read_trajectory(file);
  std::vector<Pose> poses(scans.files.size());
  if (trajectory_format(file) == TrajectoryFormat::kKitti) {
    expect_a_row_for_each(scans, file, trajectory.size(), "poses");
    for (std::size_t i = 0; i < poses.size(); ++i) poses[i] = trajectory[i].pose;
    return poses;
  }
  if (!times) {
    throw Error(ErrorCode::kInvalidArgument,
                file.string() + ": a TUM trajectory needs the times of the scans, found no " +
                    "times.txt beside them");
  }
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const std::optional<Pose> pose = trajectory.at((*times)[i]);
    if (!pose) {
      throw Error(ErrorCode::kCorruptData,
                  file.string() + ": expected a pose for " + scans.files[i].filename().string() +
                      " at " + seconds_text((*times)[i]) + " s, found poses from " +
                      seconds_text(trajectory[0].stamp) + " s to " +
                      seconds_text(trajectory[trajectory.size() - 1].stamp) + " s");
    }
    poses[i] = *pose;
  }
  return poses;
}

/// Names the text files of the folder: one of them may be the trajectory that is meant.
std::string text_files_in(const fs::path& folder) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const std::string extension = entry.path().extension().string();
    if (extension == ".txt" || extension == ".tum") names.push_back(entry.path().filename());
  }
  std::sort(names.begin(), names.end());
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text.empty() ? "no text files" : text;
}

fs::path find_poses(const fs::path& folder, const fs::path& named) {
  if (named.empty()) {
    if (fs::exists(folder / "poses.txt")) return folder / "poses.txt";
    throw Error(ErrorCode::kNotFound, folder.string() +
                                          ": expected a trajectory in poses.txt, found " +
                                          text_files_in(folder) + ": name the trajectory file");
  }
  if (fs::exists(folder / named)) return folder / named;
  if (fs::exists(named)) return named;
  throw Error(ErrorCode::kNotFound, named.string() +
                                        ": no such trajectory file, neither as given nor in " +
                                        folder.string() + ", which holds " + text_files_in(folder));
}

bool is_one_of_the_folders(const fs::path& file, const fs::path& folder) {
  std::error_code code;
  return fs::equivalent(file, folder / "poses.txt", code) ||
         fs::equivalent(file, folder / "poses_gt.txt", code);
}

std::vector<Stamp> nominal_times(std::size_t count) {
  std::vector<Stamp> stamps(count);
  for (std::size_t i = 0; i < count; ++i) stamps[i] = static_cast<Stamp>(i) * kAssumedPeriod;
  return stamps;
}

Recording read_recording(const fs::path& folder, const DatasetOptions& options) {
  Recording drive;
  drive.scans = find_scan_files(folder);
  const std::optional<std::vector<Stamp>> times = read_times(drive.scans, folder / "times.txt");
  drive.stamps = times.value_or(nominal_times(drive.scans.files.size()));

  const fs::path poses_file = find_poses(folder, options.poses);
  const Calibration calibration = read_calibration(folder / "calib.txt");
  const bool own = is_one_of_the_folders(poses_file, folder);
  PoseFrame frame = options.pose_frame;
  if (frame == PoseFrame::kAuto) frame = own ? own_frame(calibration) : PoseFrame::kSensor;
  drive.poses = poses_at_scans(poses_file, drive.scans, times);
  for (Pose& pose : drive.poses) pose = to_sensor(pose, frame, calibration);

  const fs::path truth_file = folder / "poses_gt.txt";
  if (!fs::exists(truth_file)) return drive;
  const PoseFrame truth_frame = own ? frame : own_frame(calibration);
  const std::vector<Pose> truth = poses_at_scans(truth_file, drive.scans, times);
  std::vector<StampedPose> stamped;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    stamped.push_back({drive.stamps[i], to_sensor(truth[i], truth_frame, calibration)});
  }
  drive.truth = Trajectory(std::move(stamped));
  return drive;
}

}  // namespace

std::unique_ptr<ScanSource> open_dataset(const fs::path& folder, const DatasetOptions& options) {
  Recording drive = read_recording(folder, options);
  ScanFileReader reader = options.pcl_reader;
  if (drive.scans.extension == ".bin") {
    reader = read_kitti_bin;
  } else if (!reader) {
    throw Error(ErrorCode::kUnsupported, drive.scans.folder.string() + ": holds " +
                                             drive.scans.extension +
                                             " scans, and this program reads .bin scans only: " +
                                             "use one that is built with PCL, or convert them");
  }
  return std::make_unique<RecordedDrive>(std::move(drive), std::move(reader));
}

}  // namespace cellmap
